"""A bag being recorded: messages in as they arrive, filed in an order that equal runs share."""

from __future__ import annotations

import heapq
import itertools
import struct
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rosbags.serde import SerdeError

from portnav_ros.evaluation.bag_writer import TYPES, BagError, BagWriter, Storage

STATUS_TYPE = 'diagnostic_msgs/msg/DiagnosticStatus'
STAMP_KEY = 'stamp'  # ns, in the values of a DiagnosticStatus, which has no header
CHECKPOINT_NS = 5_000_000_000  # of the messages' own time, forwards or, after a driver's restart, back
AHEAD_NS = 10_000_000_000
END_NS = 1 << 62


class RecordedTopic(NamedTuple):
    """A topic of the bag: resolved name, type and what its publisher offers.

    answer: its messages answer those of the first topic. Whether the last answer still came is chance,
    so a bag ends without it.
    """

    name: str
    message_type: str
    depth: int
    latched: bool
    answer: bool = False


class Filed(NamedTuple):
    """A message with its place in the bag: by stamp, then by topic, then as it arrived."""

    stamp_ns: int
    topic: int
    arrival: int
    data: bytes


class StampOrder:
    """Holds messages back until nothing older is to be expected."""

    def __init__(self) -> None:
        self._heap: list[Filed] = []
        self._arrivals = itertools.count()

    def push(self, stamp_ns: int, topic: int, data: bytes) -> None:
        """Take a message in."""
        heapq.heappush(self._heap, Filed(stamp_ns, topic, next(self._arrivals), data))

    def release(self, before_ns: int) -> Iterator[Filed]:
        """Give out, in order, what is older than a time."""
        while self._heap and self._heap[0].stamp_ns < before_ns:
            yield heapq.heappop(self._heap)


class Recording:
    """Files messages by (stamp, topic, arrival) into a bag.

    The first topic keeps the time. A message that is stamped more than AHEAD_NS later than its newest
    is filed under that newest, so that one message from another clock cannot spoil the order; one that is
    stamped earlier than its first, such as a map of no time, is filed under that first. A disk
    that refuses ends the recording, not the caller: see ``failure``. A message that repeats one of the
    same topic and stamp to the letter is left out: a sim that waits for an answer sends again.

    Args:
        path: folder of the bag, which must not exist yet.
        storage: file format.
        topics: what will come, by number.
        metadata: custom data.
        margin_ns: how long a message may be on its way, in the messages' own time.

    Raises:
        BagError: the bag cannot be made.
    """

    def __init__(
        self,
        path: Path,
        storage: Storage,
        topics: Sequence[RecordedTopic],
        metadata: Mapping[str, str],
        margin_ns: int,
    ) -> None:
        self.failure = ''  # why the recording has ended early; what was filed before stays readable
        self.written = 0
        self._topics = topics
        self._order = StampOrder()
        self._margin_ns = margin_ns
        self._first_ns: int | None = None
        self._newest_ns = 0
        self._checkpoint_ns = 0
        self._seen: list[tuple[int, set[bytes]]] = [(-1, set())] * len(topics)
        self._bag = BagWriter(path, storage, metadata)
        for topic in topics:
            self._bag.add_topic(topic.name, topic.message_type, topic.depth, topic.latched)
        self._bag.checkpoint()

    def push(self, topic: int, data: bytes) -> int:
        """Take in a serialised message; returns its stamp in ns.

        Raises:
            BagError: it is cut off or has no stamp that can be; it is not recorded.
        """
        stamp = stamp_ns(self._topics[topic].message_type, data)
        if topic == 0:
            self._first_ns = stamp if self._first_ns is None else self._first_ns
            self._newest_ns = max(self._newest_ns, stamp)
        else:
            stamp = self._place(stamp)
        self._order.push(stamp, topic, data)
        return stamp

    def file(self, complete_ns: int) -> None:
        """Write what is older than the margin before a time up to which everything is said to have come.

        The first topic may have fallen silent by then; time goes on without it.
        """
        if self._first_ns is not None:
            self._newest_ns = max(self._newest_ns, complete_ns)
            self._file(complete_ns - self._margin_ns)

    def close(self) -> None:
        """Write the rest and complete the bag."""
        self._file(END_NS)
        if not self.failure:
            try:
                self._bag.close()
            except BagError as error:
                self._fail(error)

    def _file(self, before_ns: int) -> None:
        for item in self._order.release(before_ns):
            if self.failure or self._is_superfluous(item):
                continue
            try:
                self._write(item)
            except BagError as error:
                self._fail(error)

    def _place(self, stamp_ns: int) -> int:
        """Where a message belongs by its stamp, once the first topic tells the time."""
        if self._first_ns is None:
            return stamp_ns
        if stamp_ns > self._newest_ns + AHEAD_NS:
            return self._newest_ns
        return max(stamp_ns, self._first_ns)

    def _is_superfluous(self, item: Filed) -> bool:
        if self._topics[item.topic].answer and item.stamp_ns >= self._newest_ns:
            return True
        stamp, seen = self._seen[item.topic]
        if stamp != item.stamp_ns:
            self._seen[item.topic] = item.stamp_ns, {item.data}
            return False
        repeated = item.data in seen
        seen.add(item.data)
        return repeated

    def _write(self, item: Filed) -> None:
        stamp = self._place(item.stamp_ns)
        if abs(stamp - self._checkpoint_ns) >= CHECKPOINT_NS:
            self._bag.checkpoint()
            self._checkpoint_ns = stamp // CHECKPOINT_NS * CHECKPOINT_NS
        self._bag.write(item.topic, stamp, item.data)
        self.written += 1

    def _fail(self, error: BagError) -> None:
        self.failure = str(error)
        self._bag.abort()


def stamp_ns(message_type: str, data: bytes) -> int:
    """Stamp of a serialised message in ns.

    A type that starts with a header has it there; a DiagnosticStatus says it in its values, or is filed
    under 0, the start of the run.

    Raises:
        BagError: it is cut off or has no stamp that can be.
    """
    try:
        if message_type == STATUS_TYPE:
            status: Any = TYPES.deserialize_cdr(data, message_type)
            stamp = next((int(pair.value) for pair in status.values if pair.key == STAMP_KEY), 0)
        else:
            seconds, nanoseconds = struct.unpack_from('<iI' if data[1] else '>iI', data, 4)
            stamp = int(seconds) * 1_000_000_000 + int(nanoseconds)
    except (SerdeError, ValueError, IndexError, struct.error) as error:
        raise BagError(f'{len(data)} bytes are no {message_type} with a stamp') from error
    if abs(stamp) >= END_NS:
        raise BagError(f'{message_type} is stamped {stamp} ns')
    return stamp
