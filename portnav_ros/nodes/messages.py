"""ROS messages to values and back: pure functions, SI units, stamps in integer nanoseconds.

Messages sent at every tick are made once (``new_*``) and filled again (``fill_*``). Foreign messages pass a
``read_*`` function, which refuses what is malformed or not finite.
"""

from __future__ import annotations

import array
import math
from collections.abc import Mapping, Sequence

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, LaserScan

from portnav_ros.geometry import polyline_yaws, yaw_of
from portnav_ros.harbour import ClearanceGrid
from portnav_ros.nodes.topics import BODY_FRAME, DESIRED_FRAME, LIDAR_FRAME, MAP_FRAME
from portnav_ros.sim.scenario import LidarParams
from portnav_ros.types import Actuation, Array, Array32, Scan, Setpoint, VesselState

SECOND_NS = 1_000_000_000
JOINTS = ['rudder', 'propulsion']
OCCUPIED = 100
LONGEST_M = 1e6  # of a path
UNKNOWN_VARIANCE = 1e6  # m^2, rad^2 and their rates


class MessageError(ValueError):
    """A message is malformed, not finite or in another frame; the message says which field."""


def write_stamp(stamp: Time, time_ns: int) -> None:
    """Set a stamp."""
    stamp.sec, stamp.nanosec = divmod(time_ns, SECOND_NS)


def read_stamp(stamp: Time) -> int:
    """Return a stamp in ns."""
    return int(stamp.sec) * SECOND_NS + int(stamp.nanosec)


def nanoseconds(time_s: float) -> int:
    """Return a time in whole ns."""
    return round(time_s * SECOND_NS)


def write_yaw(orientation: Quaternion, yaw_rad: float) -> None:
    """Set a quaternion to a turn about the vertical axis."""
    orientation.z, orientation.w = math.sin(0.5 * yaw_rad), math.cos(0.5 * yaw_rad)


def read_yaw(orientation: Quaternion) -> float:
    """Return the yaw in [-pi, pi] of a unit quaternion.

    Raises:
        MessageError: the quaternion is not finite or not of unit length.
    """
    x, y, z, w = orientation.x, orientation.y, orientation.z, orientation.w
    norm = x * x + y * y + z * z + w * w
    if not abs(norm - 1.0) < 1e-2:
        raise MessageError(f'orientation is not a unit quaternion: ({x}, {y}, {z}, {w})')
    return yaw_of(x, y, z, w)


def new_odometry(
    child_frame: str = BODY_FRAME, pose_deviation: float = 0.1, twist_deviation: float = 0.05
) -> Odometry:
    """Return an Odometry of a child frame in the map frame.

    The standard deviations are in m and rad for the pose, in m/s and rad/s for the twist. What a vessel
    in a plane does not tell (z, roll, pitch) is given a variance that no filter trusts.
    """
    message = Odometry(child_frame_id=child_frame)
    message.header.frame_id = MAP_FRAME
    for part, deviation in ((message.pose, pose_deviation), (message.twist, twist_deviation)):
        part.covariance[::7] = UNKNOWN_VARIANCE
        part.covariance[[0, 7, 35]] = deviation * deviation
    return message


def fill_odometry(message: Odometry, time_ns: int, own: Array | VesselState) -> None:
    """Write a state row [7] into an Odometry; its twist is in the body frame."""
    write_stamp(message.header.stamp, time_ns)
    pose, twist = message.pose.pose, message.twist.twist
    pose.position.x, pose.position.y = float(own[0]), float(own[1])
    write_yaw(pose.orientation, float(own[2]))
    twist.linear.x, twist.angular.z = float(own[3]), float(own[4])


def read_odometry(message: Odometry) -> VesselState:
    """Return the vessel's state; rudder and thrust, which an Odometry lacks, are 0.

    Raises:
        MessageError: another frame than ``map``, or a field that is not finite.
    """
    _check_frame(message.header.frame_id, MAP_FRAME)
    pose, twist = message.pose.pose, message.twist.twist
    state = VesselState(
        pose.position.x, pose.position.y, read_yaw(pose.orientation), twist.linear.x, twist.angular.z
    )
    _check_finite('pose or twist', state)
    return state


def new_setpoint() -> Odometry:
    """Return an Odometry that carries a setpoint."""
    return new_odometry(DESIRED_FRAME, 0.0, 0.0)


def fill_setpoint(
    message: Odometry, time_ns: int, setpoint: Setpoint, look_ahead: Sequence[float] = (0.0, 0.0)
) -> None:
    """Write desired heading and surge speed; the look-ahead point x, y in m is for display."""
    write_stamp(message.header.stamp, time_ns)
    write_yaw(message.pose.pose.orientation, setpoint.yaw_rad)
    message.twist.twist.linear.x = float(setpoint.speed_mps)
    message.pose.pose.position = Point(x=float(look_ahead[0]), y=float(look_ahead[1]))


def read_setpoint(message: Odometry) -> Setpoint:
    """Return desired heading and speed.

    Raises:
        MessageError: another frame than ``map``, or a value that is not finite.
    """
    _check_frame(message.header.frame_id, MAP_FRAME)
    setpoint = Setpoint(read_yaw(message.pose.pose.orientation), message.twist.twist.linear.x)
    _check_finite('setpoint', setpoint)
    return setpoint


def new_scan(lidar: LidarParams, period_s: float) -> LaserScan:
    """Return a LaserScan for a sensor; its first ray points astern, at -pi, and all see to the limit."""
    message = LaserScan()
    message.header.frame_id = LIDAR_FRAME
    message.angle_min = -math.pi
    message.angle_increment = 2.0 * math.pi / lidar.rays
    message.angle_max = message.angle_min + (lidar.rays - 1) * message.angle_increment
    message.scan_time = period_s
    message.range_min, message.range_max = lidar.range_min_m, lidar.range_max_m
    message.ranges = array.array('f', [lidar.range_max_m]) * lidar.rays
    return message


def fill_scan(message: LaserScan, time_ns: int, ranges: Array32) -> None:
    """Write ranges [R] in m, float32."""
    write_stamp(message.header.stamp, time_ns)
    np.frombuffer(message.ranges, dtype=np.float32)[:] = ranges


def read_scan(message: LaserScan) -> Scan:
    """Return a scan; single rays may be NaN or infinite.

    What a sensor says below range_min, 0 above all, is no distance and becomes NaN; beyond range_max there
    is no return (REP-117).

    Raises:
        MessageError: no ranges, none that tells anything, a range below 0, or angles and limits that make no
            sense.
    """
    ranges = np.array(message.ranges, dtype=np.float32)
    if len(ranges) == 0:
        raise MessageError('ranges is empty')
    if np.isnan(ranges).all():
        raise MessageError('ranges holds only NaN')
    if np.any((ranges < 0.0) & np.isfinite(ranges)):
        raise MessageError('ranges holds a distance below 0')
    scan = Scan(ranges, message.angle_min, message.angle_increment, message.range_min, message.range_max)
    _check_finite('angles or range limits', scan[1:])
    if not 0.0 <= scan.range_min_m < scan.range_max_m:
        raise MessageError(
            f'range_min {scan.range_min_m:g} and range_max {scan.range_max_m:g} are no limits of a sensor'
        )
    ranges[(ranges >= 0.0) & (ranges < scan.range_min_m)] = np.nan
    ranges[ranges > scan.range_max_m] = np.inf
    if np.isnan(ranges).all():
        raise MessageError(f'ranges holds nothing from range_min {scan.range_min_m:g} m on')
    return scan


def new_joints() -> JointState:
    """Return a JointState of rudder and propulsion: command or feedback."""
    return JointState(name=list(JOINTS), position=[0.0, 0.0], effort=[0.0, 0.0])


def fill_joints(message: JointState, time_ns: int, actuation: Actuation) -> None:
    """Write rudder angle and thrust."""
    write_stamp(message.header.stamp, time_ns)
    message.position[0] = actuation[0]
    message.effort[1] = actuation[1]


def read_joints(message: JointState) -> Actuation:
    """Return rudder angle and thrust of a command or of actuator feedback.

    Raises:
        MessageError: an unknown, missing or repeated name, a missing value, or one that is not finite.
    """
    names = message.name
    if names != JOINTS and sorted(names) != sorted(JOINTS):
        raise MessageError(f'name is {list(names)}, expected {JOINTS}')
    rudder, propulsion = (0, 1) if names == JOINTS else (1, 0)
    if len(message.position) <= rudder or len(message.effort) <= propulsion:
        raise MessageError('position lacks the rudder or effort lacks the propulsion')
    for field in (message.position, message.velocity, message.effort):
        _check_finite('position, velocity or effort', field)
    return Actuation(message.position[rudder], message.effort[propulsion])


def path_message(points: Array, time_ns: int) -> Path:
    """Return a Path of map points [W, 2]; each pose looks along the path."""
    message = Path()
    message.header.frame_id = MAP_FRAME
    write_stamp(message.header.stamp, time_ns)
    yaws = polyline_yaws(points) if len(points) > 1 else np.zeros(len(points))
    message.poses = [pose_message(x, y, yaw, time_ns) for (x, y), yaw in zip(points, yaws, strict=True)]
    return message


def read_path(message: Path) -> Array:
    """Return map points [W, 2], W = 0 for a path that says: no plan.

    Raises:
        MessageError: another frame than ``map``, a single point, one that is not finite, or too long a path.
    """
    _check_frame(message.header.frame_id, MAP_FRAME)
    points = np.array([[p.pose.position.x, p.pose.position.y] for p in message.poses]).reshape(-1, 2)
    if len(points) == 1:
        raise MessageError('poses holds a single point')
    if not np.isfinite(points).all():
        raise MessageError('poses holds a point that is not finite')
    with np.errstate(over='ignore'):
        if np.hypot(*np.diff(points, axis=0).T).sum() > LONGEST_M:
            raise MessageError(f'poses is a path of more than {LONGEST_M:g} m')
    return points


def new_pose(x_m: float, y_m: float, yaw_rad: float) -> Pose:
    """Return a pose with a turn about the vertical axis."""
    pose = Pose(position=Point(x=float(x_m), y=float(y_m)))
    write_yaw(pose.orientation, float(yaw_rad))
    return pose


def pose_message(x_m: float, y_m: float, yaw_rad: float, time_ns: int) -> PoseStamped:
    """Return a pose in the map frame, such as a goal."""
    message = PoseStamped(pose=new_pose(x_m, y_m, yaw_rad))
    message.header.frame_id = MAP_FRAME
    write_stamp(message.header.stamp, time_ns)
    return message


def read_pose(message: PoseStamped) -> tuple[float, float, float]:
    """Return x, y in m and yaw in rad.

    Raises:
        MessageError: another frame than ``map``, or a value that is not finite.
    """
    _check_frame(message.header.frame_id, MAP_FRAME)
    pose = message.pose.position.x, message.pose.position.y, read_yaw(message.pose.orientation)
    _check_finite('pose', pose)
    return pose


def clock_message(time_ns: int) -> Clock:
    """Return a simulated time."""
    message = Clock()
    write_stamp(message.clock, time_ns)
    return message


def occupancy_message(grid: ClearanceGrid, time_ns: int) -> OccupancyGrid:
    """Return the static chart: 0 on water, 100 elsewhere."""
    message = OccupancyGrid()
    message.header.frame_id = MAP_FRAME
    write_stamp(message.header.stamp, time_ns)
    message.info.resolution = float(grid.resolution_m)
    message.info.height, message.info.width = grid.distance.shape
    message.info.origin.position.x, message.info.origin.position.y = grid.x0_m, grid.y0_m
    cells = np.where(grid.distance > 0.0, 0, OCCUPIED).astype(np.int8)
    message.data = array.array('b', cells.tobytes())
    return message


def status_message(name: str, level: bytes, text: str, values: Mapping[str, object]) -> DiagnosticStatus:
    """Return a status; values become their text."""
    pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return DiagnosticStatus(level=level, name=name, message=text, values=pairs)


def read_values(message: DiagnosticStatus) -> dict[str, str]:
    """Return the key-value pairs of a status."""
    return {pair.key: pair.value for pair in message.values}


def _check_frame(frame: str, expected: str) -> None:
    if frame != expected:
        raise MessageError(f'frame is {frame!r}, expected {expected!r}')


def _check_finite(what: str, values: Sequence[float]) -> None:
    if not all(map(math.isfinite, values)):
        raise MessageError(f'{what}: a value is not finite')
