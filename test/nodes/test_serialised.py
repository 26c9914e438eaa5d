"""Bytes of a message: its stamp is read and set in place, and what is no message is refused."""

import pytest
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from std_msgs.msg import Bool

from portnav_ros.nodes.messages import MessageError, fill_odometry, new_odometry, read_stamp
from portnav_ros.nodes.serialised import peek_stamp, read_bytes, with_stamp
from portnav_ros.types import VesselState


@pytest.fixture
def data():
    message = new_odometry()
    fill_odometry(message, 1_500_000_000, VesselState(1.0, 2.0, 0.0, 3.0))
    return serialize_message(message)


def test_another_stamp_changes_nothing_else(data):
    later = with_stamp(data, 7_000_000_001)
    assert (peek_stamp(data), peek_stamp(later)) == (1_500_000_000, 7_000_000_001)
    message = read_bytes(later, Odometry)
    assert read_stamp(message.header.stamp) == 7_000_000_001
    assert message.twist.twist.linear.x == 3.0
    assert with_stamp(later, 1_500_000_000) == data


@pytest.mark.parametrize('size', [0, 1, 4, 11])
def test_too_few_bytes_have_no_stamp(data, size):
    with pytest.raises(MessageError, match=f'{size} bytes have no header'):
        peek_stamp(data[:size])


def test_what_is_cut_off_or_of_another_type_is_refused(data):
    for other in (data[:100], serialize_message(Bool(data=True))):
        with pytest.raises(MessageError, match=f'{len(other)} bytes are no Odometry'):
            read_bytes(other, Odometry)
