"""Who cannot hear whom: publishers that offer less than a subscription asks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

TYPE = 'TYPE'


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
        topic: relative name, for the mend.
        ends: of the topic.
    """
    for publisher in ends.publishers:
        for subscriber in ends.subscribers:
            if publisher.type != subscriber.type:
                yield _mismatch(publisher, subscriber, TYPE, f'publish {subscriber.type}')
            elif subscriber.reliable and not publisher.reliable:
                yield _mismatch(publisher, subscriber, 'RELIABILITY', _mend(topic, 'reliability', 'reliable'))
            elif subscriber.latched and not publisher.latched:
                offer = _mend(topic, 'durability', 'transient_local')
                yield _mismatch(publisher, subscriber, 'DURABILITY', offer)


def _mismatch(publisher: End, subscriber: End, policy: str, mend: str) -> Mismatch:
    return Mismatch(publisher.node, subscriber.node, policy, mend)


def _mend(topic: str, policy: str, offer: str) -> str:
    weak = 'best_effort' if policy == 'reliability' else 'volatile'
    return (
        f'let the publisher offer {offer}, or the subscription ask for {weak}: '
        f'-p qos_overrides./{topic}.subscription.{policy}:={weak}'
    )
