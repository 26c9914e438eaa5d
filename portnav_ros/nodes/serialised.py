"""Messages as the bytes that they travel as: CDR, 4 bytes that tell the byte order before the first field."""

from __future__ import annotations

import struct
from typing import TypeVar

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.serialization import deserialize_message

from portnav_ros.nodes.messages import SECOND_NS, MessageError

T = TypeVar('T')

PREAMBLE = 4  # bytes
STAMP = struct.calcsize('<iI')


def peek_stamp(data: bytes) -> int:
    """Return the stamp in ns of a message that begins with a header.

    Raises:
        MessageError: there is no room for one.
    """
    if len(data) < PREAMBLE + STAMP:
        raise MessageError(f'{len(data)} bytes have no header')
    seconds, nanosec = struct.unpack_from(_layout(data), data, PREAMBLE)
    return int(seconds) * SECOND_NS + int(nanosec)


def with_stamp(data: bytes, time_ns: int) -> bytes:
    """Return a message that begins with a header, with another stamp."""
    stamped = bytearray(data)
    struct.pack_into(_layout(data), stamped, PREAMBLE, *divmod(time_ns, SECOND_NS))
    return bytes(stamped)


def read_bytes(data: bytes, message_type: type[T]) -> T:
    """Return a message of a type.

    Raises:
        MessageError: the bytes are not of that type, or cut off.
    """
    try:
        message: T = deserialize_message(data, message_type)
    except rclpy_implementation.RMWError:
        raise MessageError(f'{len(data)} bytes are no {message_type.__name__}') from None
    return message


def _layout(data: bytes) -> str:
    return '<iI' if data[1] else '>iI'
