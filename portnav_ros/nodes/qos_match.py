"""Who cannot hear whom: publishers that offer less than a subscription asks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

TYPE, RELIABILITY, DURABILITY = 'TYPE', 'RELIABILITY', 'DURABILITY'
VALUES = {
    RELIABILITY: ('reliable', 'best_effort'),
    DURABILITY: ('transient_local', 'volatile'),
}  # strong, weak


class End(NamedTuple):
    """A publisher or a subscription. reliable, latched: what it offers or asks; type: of its messages."""

    node: str
    reliable: bool = True
    latched: bool = False
    type: str = ''


class Ends(NamedTuple):
    """Who speaks on a topic, and who listens."""

    publishers: tuple[End, ...] = ()
    subscribers: tuple[End, ...] = ()


class Mismatch(NamedTuple):
    """A publisher and a subscription that the middleware does not join. policy: what does not fit."""

    publisher: str
    subscriber: str
    policy: str
    mend: str

    def __str__(self) -> str:
        """What follows from it."""
        what = 'another type' if self.policy == TYPE else 'incompatible QoS'
        return f'{self.subscriber} does not hear {self.publisher}: {what} ({self.policy})'


def mismatches(topic: str, ends: Ends) -> Iterator[Mismatch]:
    """Yield the pairs on a topic that do not match; a publisher must offer at least what is asked.

    Args:
        topic: resolved name, for the mend.
        ends: of the topic. A node may listen twice, of which one must match.
    """
    for publisher in ends.publishers:
        found = [(subscriber, _policy(publisher, subscriber)) for subscriber in ends.subscribers]
        hearing = {subscriber.node for subscriber, policy in found if not policy}
        for subscriber, policy in found:
            if policy and subscriber.node not in hearing:
                mend = _mend(topic, policy, subscriber)
                yield Mismatch(publisher.node, subscriber.node, policy, mend)


def _policy(publisher: End, subscriber: End) -> str:
    """What does not match, empty where all does."""
    if publisher.type != subscriber.type:
        return TYPE
    if subscriber.reliable and not publisher.reliable:
        return RELIABILITY
    return DURABILITY if subscriber.latched and not publisher.latched else ''


def _mend(topic: str, policy: str, subscriber: End) -> str:
    if policy == TYPE:
        return f'publish {subscriber.type}'
    strong, weak = VALUES[policy]
    return (
        f'let the publisher offer {strong}, or the subscription ask for {weak}: '
        f'-p qos_overrides.{topic}.subscription.{policy.lower()}:={weak}'
    )
