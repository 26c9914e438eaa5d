"""What a node tells the process that started it: that it is ready, and how it is getting on.

The bringup hands each node one end of a pipe through the environment. A node that was started by hand
has no pipe and its reports go nowhere.
"""

from __future__ import annotations

import json
import os
from typing import Any

STATUS_FD = 'PORTNAV_STATUS_FD'


def report_ready() -> None:
    """Tell the bringup that this node's publishers, subscribers and services stand."""
    report(ready=True)


def report(**values: Any) -> None:
    """Send one line of values, such as ``time_s=3.0``; never waits and never fails.

    A line is lost where the bringup is gone or does not keep up.
    """
    descriptor = os.environ.get(STATUS_FD)
    if descriptor is None:
        return
    try:
        os.write(int(descriptor), json.dumps(values).encode() + b'\n')
    except (BrokenPipeError, BlockingIOError):
        return


class StatusReader:
    """The bringup's end of the pipe: bytes in, mappings out."""

    def __init__(self) -> None:
        self.descriptor, self.writer = os.pipe()
        os.set_blocking(self.descriptor, False)
        os.set_blocking(self.writer, False)
        self.open = True
        self._rest = b''

    def read(self) -> list[dict[str, Any]]:
        """Reports that have come since the last call; clears ``open`` once every writer has gone."""
        try:
            data = os.read(self.descriptor, 1 << 16)
        except BlockingIOError:
            return []
        self.open = bool(data)
        *lines, self._rest = (self._rest + data).split(b'\n')
        return [json.loads(line) for line in lines]

    def close(self) -> None:
        """Give the descriptor back."""
        os.close(self.descriptor)
