"""Messages survive the way there and back; what is broken is refused by name."""

import array
import math

import numpy as np
import pytest
from geometry_msgs.msg import Quaternion
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from portnav_ros.harbour import ClearanceGrid
from portnav_ros.nodes import markers, messages
from portnav_ros.nodes.messages import MessageError
from portnav_ros.nodes.serialised import peek_stamp
from portnav_ros.sim.scenario import LidarParams
from portnav_ros.types import Actuation, Setpoint, VesselState

NUMBER = st.floats(-1e6, 1e6)
PLACE_M = st.floats(-1e4, 1e4)
ANGLE = st.floats(-math.pi, math.pi)
TIME_NS = st.integers(0, 2**31 * 10**9 - 1)


def travel(message):
    """Send a message through the wire format."""
    return deserialize_message(serialize_message(message), type(message))


STATE = VesselState(1.0, 2.0, 0.3, 4.0, 0.05)


def odometry(state=STATE, time_ns=0):
    message = messages.new_odometry()
    messages.fill_odometry(message, time_ns, state)
    return message


@given(TIME_NS, NUMBER, NUMBER, ANGLE, NUMBER, NUMBER)
def test_odometry(time_ns, x, y, yaw, surge, rate):
    message = travel(odometry(VesselState(x, y, yaw, surge, rate), time_ns))
    assert messages.read_stamp(message.header.stamp) == time_ns
    assert peek_stamp(serialize_message(message)) == time_ns
    assert (message.header.frame_id, message.child_frame_id) == ('map', 'base_link')
    back = messages.read_odometry(message)
    assert (back.x_m, back.y_m, back.surge_mps, back.yaw_rate_radps) == (x, y, surge, rate)
    assert math.cos(back.yaw_rad - yaw) == pytest.approx(1.0, abs=1e-15)


@given(TIME_NS, ANGLE, NUMBER)
def test_setpoint(time_ns, yaw, speed):
    message = messages.new_setpoint()
    messages.fill_setpoint(message, time_ns, Setpoint(yaw, speed), (3.0, 4.0))
    message = travel(message)
    assert message.child_frame_id == 'base_link_desired'
    assert messages.read_setpoint(message) == pytest.approx((yaw, speed), abs=1e-9) or abs(yaw) > 3.14


@given(st.integers(8, 400), st.integers(0, 2**32 - 1))
def test_scan(rays, seed):
    lidar = LidarParams(rays=rays)
    ranges = np.random.default_rng(seed).uniform(0.5, 300.0, rays).astype(np.float32)
    ranges[0], ranges[1], ranges[2] = np.inf, np.nan, -np.inf
    message = messages.new_scan(lidar, 0.1)
    messages.fill_scan(message, 7, ranges)
    scan = messages.read_scan(travel(message))
    np.testing.assert_array_equal(scan.ranges, ranges)
    last = scan.angle_min_rad + (rays - 1) * scan.angle_increment_rad
    assert last == pytest.approx(math.pi - 2.0 * math.pi / rays, abs=1e-4)


@given(TIME_NS, NUMBER, NUMBER)
def test_joints_in_either_order(time_ns, rudder, thrust):
    message = messages.new_joints()
    messages.fill_joints(message, time_ns, Actuation(rudder, thrust))
    assert messages.read_joints(travel(message)) == (rudder, thrust)
    message.name.reverse()
    message.position, message.effort = array.array('d', [0.0, rudder]), array.array('d', [thrust, 0.0])
    assert messages.read_joints(travel(message)) == (rudder, thrust)


@given(st.lists(st.tuples(PLACE_M, PLACE_M), max_size=20).filter(lambda points: len(points) != 1))
def test_path(points):
    points = np.array(points).reshape(-1, 2)
    np.testing.assert_array_equal(messages.read_path(travel(messages.path_message(points, 5))), points)


def test_poses_of_a_path_look_along_it():
    message = messages.path_message(np.array([[0.0, 0.0], [0.0, 10.0], [0.0, 20.0]]), 0)
    assert messages.read_pose(message.poses[1]) == pytest.approx((0.0, 10.0, math.pi / 2))


def test_the_map_is_occupied_where_there_is_no_water():
    grid = ClearanceGrid(np.array([[0.0, 5.0, 2.0], [0.0, 0.0, 1.0]], np.float32), -4.0, 6.0, 2.5)
    message = messages.occupancy_message(grid, 0)
    assert (message.info.width, message.info.height, message.info.resolution) == (3, 2, 2.5)
    assert (message.info.origin.position.x, message.info.origin.position.y) == (-4.0, 6.0)
    assert list(message.data) == [100, 0, 0, 100, 100, 0]


def test_markers_have_the_size_of_what_they_show():
    hull = markers.hull_marker(3, 1.0, 2.0, 0.5, (20.0, 5.0), (1.0, 0.0, 0.0))
    buoy = markers.buoy_markers(np.array([[7.0, 8.0, 1.5]])).markers[0]
    assert (hull.id, hull.scale.x, hull.scale.y) == (3, 20.0, 5.0)
    assert (buoy.pose.position.x, buoy.scale.x) == (7.0, 3.0)
    assert hull.header.frame_id == buoy.header.frame_id == 'map'


def test_tracks_are_drawn_from_end_to_end_and_to_where_they_will_be():
    marker = markers.sighting_marker(np.array([[7.0, 8.0, 1.0, -2.0, 5.0, 6.0, 9.0, 10.0]]), lead_s=10.0)
    points = [(point.x, point.y) for point in marker.points]
    assert points == [(5.0, 6.0), (9.0, 10.0), (7.0, 8.0), (17.0, -12.0)]
    assert len(markers.sighting_marker(np.zeros((0, 8))).points) == 0


def test_a_status_keeps_its_values():
    message = messages.status_message('sim', b'\x01', 'text', {'time_s': 1.5, 'outcome': 'RUNNING'})
    assert messages.read_values(travel(message)) == {'time_s': '1.5', 'outcome': 'RUNNING'}


BAD = [math.nan, math.inf, -math.inf]


@pytest.mark.parametrize('bad', BAD)
def test_an_odometry_that_is_not_finite_is_refused(bad):
    with pytest.raises(MessageError, match='not finite'):
        messages.read_odometry(odometry(VesselState(bad, 0.0, 0.0)))
    broken = odometry()
    broken.pose.pose.orientation.z = bad
    with pytest.raises(MessageError, match='quaternion'):
        messages.read_odometry(broken)


def test_an_odometry_in_another_frame_is_refused():
    message = odometry()
    message.header.frame_id = 'odom'
    with pytest.raises(MessageError, match="'odom', expected 'map'"):
        messages.read_odometry(message)


def test_a_quaternion_of_zeros_is_refused():
    with pytest.raises(MessageError, match='unit quaternion'):
        messages.read_yaw(Quaternion(w=0.0))


@pytest.mark.parametrize(
    ('ranges', 'reason'),
    [
        ([], 'empty'),
        ([math.nan] * 9, 'only NaN'),
        ([5.0, -1.0], 'below 0'),
        ([0.0] * 9, 'nothing from range_min 0.5 m on'),
        ([0.1, math.nan, 0.4], 'nothing from range_min'),
    ],
)
def test_a_scan_that_says_nothing_is_refused(ranges, reason):
    message = messages.new_scan(LidarParams(), 0.1)
    message.ranges = array.array('f', ranges)
    with pytest.raises(MessageError, match=reason):
        messages.read_scan(message)


def test_what_lies_outside_of_the_limits_is_no_distance():
    message = messages.new_scan(LidarParams(), 0.1)
    message.ranges = array.array('f', [0.0, 0.4, 0.5, 400.0, 400.5, 1e9, math.inf, -math.inf])
    read = messages.read_scan(message).ranges
    np.testing.assert_array_equal(
        read, [math.nan, math.nan, 0.5, 400.0, math.inf, math.inf, math.inf, -math.inf]
    )


@pytest.mark.parametrize('limits', [(0.0, 0.0), (5.0, 1.0), (-1.0, 10.0)])
def test_limits_of_no_sensor_are_refused(limits):
    message = messages.new_scan(LidarParams(), 0.1)
    message.range_min, message.range_max = limits
    with pytest.raises(MessageError, match='no limits of a sensor'):
        messages.read_scan(message)


@pytest.mark.parametrize('bad', BAD)
def test_joints_that_are_not_finite_are_refused(bad):
    for actuation in (Actuation(bad, 0.0), Actuation(0.0, bad)):
        message = messages.new_joints()
        messages.fill_joints(message, 0, actuation)
        with pytest.raises(MessageError, match='not finite'):
            messages.read_joints(message)


@pytest.mark.parametrize('names', [['rudder'], ['rudder', 'bow_thruster'], ['rudder', 'rudder'], []])
def test_joints_of_another_vessel_are_refused(names):
    message = messages.new_joints()
    message.name = names
    with pytest.raises(MessageError, match='name is'):
        messages.read_joints(message)


def test_joints_without_values_are_refused():
    message = messages.new_joints()
    message.effort = array.array('d')
    with pytest.raises(MessageError, match='lacks'):
        messages.read_joints(message)


def test_a_path_with_a_hole_is_refused():
    points = np.array([[0.0, 0.0], [np.nan, 1.0]])
    with pytest.raises(MessageError, match='not finite'):
        messages.read_path(messages.path_message(points, 0))
    with pytest.raises(MessageError, match='single point'):
        messages.read_path(messages.path_message(points[:1], 0))


@pytest.mark.parametrize('far_m', [2e6, 1e308])
def test_a_path_around_the_world_is_refused(far_m):
    points = np.array([[0.0, 0.0], [10.0, 0.0], [-far_m, far_m]])
    with pytest.raises(MessageError, match='more than 1e\\+06 m'):
        messages.read_path(messages.path_message(points, 0))


def test_what_a_vessel_in_a_plane_does_not_tell_is_not_to_be_trusted():
    message = messages.new_odometry()
    for covariance in (message.pose.covariance, message.twist.covariance):
        variances = np.asarray(covariance).reshape(6, 6).diagonal()
        assert (variances[[0, 1, 5]] < 1.0).all()
        assert (variances[[2, 3, 4]] >= 1e6).all()
