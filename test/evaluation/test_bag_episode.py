"""The episode that a bag tells: what was written comes back in the rows of a log."""

import json

import numpy as np
import pytest
import shapely

from portnav_ros.charts import write_geojson
from portnav_ros.evaluation.bag_episode import CHART, LOST, RENAMED, read_episode
from portnav_ros.evaluation.bag_writer import TYPES, BagError, BagWriter
from portnav_ros.harbour import Harbour
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


@pytest.mark.parametrize(('end_x_m', 'outcome'), [(61.0, Outcome.SUCCESS), (59.0, Outcome.RUNNING)])
def test_without_a_sim_the_plan_tells_the_goal(tmp_path, end_x_m, outcome):
    others = [row for row in rows() if row[1] != 'episode']
    end = 2.0, 'odom', odometry(2.0, x=end_x_m)
    record(tmp_path, [*others, end], METADATA | {'goal': '[-5.0, -5.0]'})
    log = read_episode(tmp_path)
    assert log.goal == (100.0, 0.0)
    assert log.outcome is outcome
