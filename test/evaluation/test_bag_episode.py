"""The episode that a bag tells: what was written comes back in the rows of a log."""

import json

import numpy as np
import pytest
import shapely

from portnav_ros.charts import write_geojson
from portnav_ros.evaluation.bag_episode import CHART, LOST, MOUNTING, RENAMED, read_episode
from portnav_ros.evaluation.bag_writer import TYPES, BagError, BagWriter
from portnav_ros.evaluation.metrics.table import measure
from portnav_ros.harbour import Harbour
from portnav_ros.safety.mounting import Mounting
from portnav_ros.types import Outcome

TYPE = {
    'odom': 'nav_msgs/msg/Odometry',
    'setpoint': 'nav_msgs/msg/Odometry',
    'targets': 'nav_msgs/msg/Odometry',
    'cmd_actuators': 'sensor_msgs/msg/JointState',
    'joint_states': 'sensor_msgs/msg/JointState',
    'scan': 'sensor_msgs/msg/LaserScan',
    'plan': 'nav_msgs/msg/Path',
    'episode': 'diagnostic_msgs/msg/DiagnosticStatus',
}
METADATA = {
    'seed': '7',
    'scenario': 'basin',
    'difficulty': 'easy',
    'planner': 'dwa',
    'goal': '[100.0, 0.0]',
    'goal_radius_m': '40.0',
    'vessel': '{}',
    'hulls': '[[20.0, 5.0], [30.0, 6.0]]',
    'commit': 'abc',
}


def make(name: str, *values: object) -> object:
    return TYPES.types[name](*values)


def header(time_s: float) -> object:
    seconds = int(time_s)
    nanoseconds = round((time_s - seconds) * 1e9)
    return make('std_msgs/msg/Header', make('builtin_interfaces/msg/Time', seconds, nanoseconds), 'map')


def pose(x: float, y: float, yaw: float) -> object:
    turn = make('geometry_msgs/msg/Quaternion', 0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2))
    return make('geometry_msgs/msg/Pose', make('geometry_msgs/msg/Point', x, y, 0.0), turn)


def odometry(time_s, x=0.0, y=0.0, yaw=0.0, surge=0.0, rate=0.0, child='base_link') -> object:
    vector = TYPES.types['geometry_msgs/msg/Vector3']
    twist = make('geometry_msgs/msg/Twist', vector(surge, 0.0, 0.0), vector(0.0, 0.0, rate))
    return make(
        TYPE['odom'],
        header(time_s),
        child,
        make('geometry_msgs/msg/PoseWithCovariance', pose(x, y, yaw), np.zeros(36)),
        make('geometry_msgs/msg/TwistWithCovariance', twist, np.zeros(36)),
    )


def joints(time_s: float, rudder: float, thrust: float) -> object:
    values = (np.array([rudder, 0.0]), np.zeros(0), np.array([0.0, thrust]))
    return make(TYPE['cmd_actuators'], header(time_s), ['rudder', 'propulsion'], *values)


def scan(time_s: float, *ranges: float) -> object:
    values = np.array(ranges, np.float32)
    return make(TYPE['scan'], header(time_s), -3.0, 3.0, 2.0, 0.0, 0.1, 0.5, 300.0, values, values[:0])


def plan(time_s: float, points) -> object:
    poses = [make('geometry_msgs/msg/PoseStamped', header(time_s), pose(x, y, 0.0)) for x, y in points]
    return make(TYPE['plan'], header(time_s), poses)


def episode(outcome: str) -> object:
    pair = make('diagnostic_msgs/msg/KeyValue', 'outcome', outcome)
    return make(TYPE['episode'], 0, 'episode', '', '', [pair])


def record(folder, rows, metadata=METADATA, names=None):
    bag = BagWriter(folder / 'bag', 'sqlite3', metadata)
    names = {name: f'/ns/{name}' for name in TYPE} | (names or {})
    numbers = {name: bag.add_topic(names[name], kind) for name, kind in TYPE.items()}
    for time_s, name, message in rows:
        data = bytes(TYPES.serialize_cdr(message, TYPE[name]))
        bag.write(numbers[name], round(time_s * 1e9), data)
    bag.close()
    box = Harbour('basin', shapely.geometry.box(-50.0, -50.0, 150.0, 50.0))
    write_geojson(box, folder / 'bag' / CHART)


def rows():
    yield 0.0, 'plan', plan(0.0, [])
    yield 0.0, 'plan', plan(0.0, [(0.0, 0.0), (50.0, 0.0), (100.0, 0.0)])
    for tick in range(4):
        time_s = tick * 0.5
        yield time_s, 'odom', odometry(time_s, x=float(tick), y=-1.0, yaw=0.1, surge=2.0, rate=0.01)
        yield time_s, 'joint_states', joints(time_s, 0.2, 100.0 * tick)
        if tick % 2 == 0:
            yield time_s, 'scan', scan(time_s, np.inf, 30.0 - tick, np.nan)
            yield time_s, 'targets', odometry(time_s, x=9.0, surge=3.0, child='target/0')
            yield time_s, 'targets', odometry(time_s, x=8.0, surge=4.0, child='target/1')
            yield time_s, 'setpoint', odometry(time_s, yaw=0.3 + tick, surge=5.0)
        yield time_s, 'cmd_actuators', joints(time_s, 0.4, 50.0)
    yield 1.5, 'episode', episode('SUCCESS')


def test_rows_come_back(tmp_path):
    record(tmp_path, rows())
    log = read_episode(tmp_path)
    assert log.time_s == pytest.approx([0.0, 0.5, 1.0, 1.5])
    assert log.own[3] == pytest.approx([3.0, -1.0, 0.1, 2.0, 0.01, 0.2, 300.0])
    assert log.setpoint[:, 0] == pytest.approx([0.3, 0.3, 2.3, 2.3])
    assert log.command == pytest.approx(np.tile([0.4, 50.0], (4, 1)))
    assert log.range_min == pytest.approx([30.0, 30.0, 28.0, 28.0])
    assert log.path.shape == (3, 2)
    assert log.outcome is Outcome.SUCCESS
    assert [(t.name, t.length_m, len(t.time_s)) for t in log.targets] == [
        ('target/0', 20.0, 2),
        ('target/1', 30.0, 2),
    ]
    assert log.targets[1].pose[0] == pytest.approx([8.0, 0.0, 0.0, 4.0])
    assert log.scans is not None
    assert log.scans.ranges.shape == (2, 3)


def test_topics_that_were_remapped_are_found(tmp_path):
    renamed = json.dumps({'/ship/odometry': 'odom', '/lidar': 'scan'})
    names = {'odom': '/ship/odometry', 'scan': '/lidar'}
    record(tmp_path, rows(), METADATA | {RENAMED: renamed}, names)
    log = read_episode(tmp_path)
    assert log.own[3, 0] == 3.0
    assert log.scans is not None
    assert RENAMED not in log.metadata


def test_facts_come_from_the_metadata_and_the_chart(tmp_path):
    record(tmp_path, rows(), METADATA | {'vessel': json.dumps({'length_m': 33.0})})
    log = read_episode(tmp_path)
    assert (log.seed, log.scenario, log.difficulty, log.planner) == (7, 'basin', 'easy', 'dwa')
    assert (log.goal, log.goal_radius_m, log.vessel.length_m) == ((100.0, 0.0), 40.0, 33.0)
    assert log.metadata == {'commit': 'abc'}
    assert log.harbour.bounds == (-50.0, -50.0, 150.0, 50.0)


@pytest.mark.parametrize(
    ('without', 'message'), [('odom', 'no odometry'), ('plan', r'no plan.*global planner')]
)
def test_a_bag_without_what_it_takes_is_refused(tmp_path, without, message):
    record(tmp_path, [row for row in rows() if row[1] != without])
    with pytest.raises(BagError, match=message):
        read_episode(tmp_path)


def test_a_foreign_bag_is_refused_with_the_key_it_lacks(tmp_path):
    record(tmp_path, rows(), {'seed': '7'})
    with pytest.raises(BagError, match=r'metadata\.yaml.*goal'):
        read_episode(tmp_path)


def test_a_missing_chart_is_told(tmp_path):
    record(tmp_path, rows())
    (tmp_path / 'bag' / CHART).unlink()
    with pytest.raises(BagError, match=CHART):
        read_episode(tmp_path)


def test_an_unfinished_recording_says_so(tmp_path):
    record(tmp_path, (row for row in rows() if row[1] != 'episode'))
    metadata = tmp_path / 'bag' / 'metadata.yaml'
    metadata.write_text(metadata.read_text().replace("complete: 'true'", "complete: 'false'"))
    log = read_episode(tmp_path)
    assert log.outcome is Outcome.RUNNING
    assert 'cut off' in log.metadata[LOST]


@pytest.mark.parametrize(
    ('topic', 'message'),
    [
        ('odom', odometry(0.75, x=np.nan)),
        ('targets', odometry(0.75, y=np.inf, child='target/0')),
        ('cmd_actuators', make(TYPE['cmd_actuators'], header(0.75), ['engine'], *[np.zeros(1)] * 3)),
        (
            'joint_states',
            make(TYPE['joint_states'], header(0.75), ['rudder', 'propulsion'], *[np.zeros(0)] * 3),
        ),
        ('setpoint', odometry(0.75, surge=np.nan)),
        ('plan', plan(0.75, [(0.0, 0.0), (np.nan, 0.0)])),
        ('scan', scan(0.75)),
        ('episode', episode('BANG')),
    ],
)
def test_what_the_nodes_refuse_is_left_out(tmp_path, topic, message):
    (tmp_path / 'whole').mkdir()
    (tmp_path / 'other').mkdir()
    record(tmp_path / 'whole', rows())
    record(tmp_path / 'other', sorted([*rows(), (0.75, topic, message)], key=lambda row: row[0]))
    whole, other = read_episode(tmp_path / 'whole'), read_episode(tmp_path / 'other')
    assert other.metadata[LOST] == f'1 that cannot be used on {topic}'
    for name in ('time_s', 'own', 'setpoint', 'path', 'command', 'range_min'):
        np.testing.assert_array_equal(getattr(whole, name), getattr(other, name), err_msg=name)
    assert whole.outcome is other.outcome


@pytest.mark.parametrize(
    ('key', 'value'),
    [
        ('vessel', '[]'),
        ('hulls', '[[1.0]]'),
        ('hulls', '{}'),
        ('renamed', '[]'),
        ('mounting', '7'),
        ('goal', '1'),
    ],
)
def test_damaged_metadata_is_refused_by_name(tmp_path, key, value):
    record(tmp_path, rows(), METADATA | {key: value})
    with pytest.raises(BagError, match=str(tmp_path)):
        read_episode(tmp_path)


def test_what_nobody_tells_is_not_known(tmp_path):
    record(tmp_path, [row for row in rows() if row[1] != 'joint_states'])
    log = read_episode(tmp_path)
    assert np.isnan(log.own[:, 5:]).all()
    assert np.isfinite(log.own[:, :5]).all()
    values = measure(log)
    assert np.isnan([values['control_effort'], values['rudder_reversals_per_min']]).all()


def test_a_trip_begins_with_its_first_plan(tmp_path):
    berth = [(0.1 * k, 'odom', odometry(0.1 * k, x=-40.0)) for k in range(9)]
    sailed = [(time_s + 1.0, name, message) for time_s, name, message in rows()]
    record(tmp_path, [*berth, *sailed])
    log = read_episode(tmp_path)
    assert log.time_s == pytest.approx([1.0, 1.5, 2.0, 2.5])
    assert not log.earlier_plans


def sail(points, first_s):
    """Odometry a second along points, 1 m a second."""
    return [(first_s + k, 'odom', odometry(first_s + k, *points(float(k)), surge=1.0)) for k in range(50)]


def test_errors_are_counted_from_the_plan_of_the_time(tmp_path):
    there, back = [(0.0, 0.0), (100.0, 0.0)], [(50.0, 0.0), (50.0, 49.0)]
    east = [(0.0, 'plan', plan(0.0, dense(there))), *sail(lambda k: (k, 0.0, 0.0), 0.0)]
    north = [(50.0, 'plan', plan(50.0, dense(back))), *sail(lambda k: (50.0, k, np.pi / 2), 50.0)]
    record(tmp_path, [*east, *north])
    log = read_episode(tmp_path)
    assert (len(log.earlier_plans), log.path_since_s, log.goal_moved) == (1, 50.0, True)
    assert abs(log.errors[:, :2]).max() < 1.0
    assert log.outcome is Outcome.SUCCESS
    assert np.isnan(measure(log)['path_over_plan'])


def test_a_detour_is_measured_by_the_first_plan(tmp_path):
    first, again = dense([(0.0, 0.0), (98.0, 0.0)]), dense([(50.0, 0.0), (98.0, 0.0)])
    east = [(0.0, 'plan', plan(0.0, first)), *sail(lambda k: (k, 0.0, 0.0), 0.0)]
    on = [(50.0, 'plan', plan(50.0, again)), *sail(lambda k: (50.0 + k, 0.0, 0.0), 50.0)]
    record(tmp_path, [*east, *on])
    log = read_episode(tmp_path)
    assert len(log.earlier_plans) == 1
    assert not log.goal_moved
    assert measure(log)['path_over_plan'] == pytest.approx(1.0, abs=0.03)  # 0.5 without the first


def dense(points):
    """The points of a way a metre apart."""
    (x0, y0), (x1, y1) = points
    count = round(np.hypot(x1 - x0, y1 - y0)) + 1
    return list(zip(np.linspace(x0, x1, count), np.linspace(y0, y1, count), strict=True))


def test_yaw_is_that_of_a_hull_that_heels(tmp_path):
    roll, pitch, yaw = np.radians([15.0, 8.0, 0.0])
    (cr, cp, cy), (sr, sp, sy) = (
        np.cos([roll / 2, pitch / 2, yaw / 2]),
        np.sin([roll / 2, pitch / 2, yaw / 2]),
    )
    message = odometry(2.0)
    message.pose.pose.orientation.x = sr * cp * cy - cr * sp * sy
    message.pose.pose.orientation.y = cr * sp * cy + sr * cp * sy
    message.pose.pose.orientation.z = cr * cp * sy - sr * sp * cy
    message.pose.pose.orientation.w = cr * cp * cy + sr * sp * sy
    record(tmp_path, [*rows(), (2.0, 'odom', message)])
    assert read_episode(tmp_path).own[-1, 2] == pytest.approx(0.0, abs=1e-9)


def test_the_bag_tells_where_the_sensor_is(tmp_path):
    record(tmp_path, rows(), METADATA | {MOUNTING: '{"x_m": 50.0, "yaw_rad": 1.5}'})
    assert read_episode(tmp_path).scans.mounting == Mounting(50.0, 0.0, 1.5)


@pytest.mark.parametrize(('end_x_m', 'outcome'), [(61.0, Outcome.SUCCESS), (59.0, Outcome.RUNNING)])
def test_without_a_sim_the_plan_tells_the_goal(tmp_path, end_x_m, outcome):
    others = [row for row in rows() if row[1] != 'episode']
    end = 2.0, 'odom', odometry(2.0, x=end_x_m)
    record(tmp_path, [*others, end], METADATA | {'goal': '[-5.0, -5.0]'})
    log = read_episode(tmp_path)
    assert log.goal == (100.0, 0.0)
    assert log.outcome is outcome
