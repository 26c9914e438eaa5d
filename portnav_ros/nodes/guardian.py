"""Ends the nodes of a bringup that can no longer do so itself, because it was killed.

A process of its own, in a session of its own: it reads from its standard input which process groups
run ("GROUP", and "-GROUP" for one that has ended) and acts when that pipe closes. Standard library only, so
that it starts at once.
"""

import os
import signal
import sys
import time

GRACE_S = 5.0  # between asking a group to end and killing it


def main() -> None:
    """Follow the bringup until it is gone, then end what it has left."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    groups: set[int] = set()
    for line in sys.stdin:
        group = int(line)
        groups.add(group) if group > 0 else groups.discard(-group)
    end_groups(groups, GRACE_S)


def end_groups(groups: set[int], grace_s: float) -> None:
    """Ask every process group to end; kill those that still stand after the grace."""
    limit_s = time.monotonic() + grace_s
    alive = {group for group in groups if _signal(group, signal.SIGTERM)}
    while alive and time.monotonic() < limit_s:
        time.sleep(0.02)
        alive = {group for group in alive if _signal(group, 0)}
    for group in alive:
        _signal(group, signal.SIGKILL)


def _signal(group: int, number: int) -> bool:
    try:
        os.killpg(group, number)
    except ProcessLookupError:
        return False
    return True


if __name__ == '__main__':
    main()
