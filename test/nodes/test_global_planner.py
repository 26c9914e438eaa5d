"""The global planner as a process: map, plans for goals and requests, reasons for what cannot be planned."""

import math
import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Goals
from nav_msgs.srv import GetPlan
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future
from shapely.geometry import box

from portnav_ros.charts import read_chart, write_geojson
from portnav_ros.harbour import Harbour
from portnav_ros.nodes.global_planner import Route
from portnav_ros.nodes.messages import fill_odometry, new_odometry, pose_message, read_path, read_values
from portnav_ros.nodes.status_pipe import STATUS_FD
from portnav_ros.nodes.topics import BODY_FRAME, TOPICS, offered_qos
from portnav_ros.planning.rrt_star import RrtStarParams, plan_route
from portnav_ros.types import VesselState

DOMAIN = 20
WAIT_S = 20.0
START, GOAL, LAND = (100.0, 900.0), (1900.0, 900.0), (1000.0, 900.0)
STAMP_NS = 1_500_000_000
PARAMETERS = {'seed': 4, 'hull_clearance_m': 20.0, 'rrt_star': {'iterations': 1000}}


class Bridge:
    """The rest of the graph: sends goals, odometry and requests, and waits for what comes."""

    def __init__(self, context: Context) -> None:
        self.node = rclpy.create_node('bridge', context=context)
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(self.node)
        self.client = self.node.create_client(GetPlan, 'global_planner/get_plan')
        self._publishers = {
            name: self.node.create_publisher(TOPICS[name].type, name, offered_qos(TOPICS[name]))
            for name in ('odom', 'goal_pose', 'goal_poses')
        }
        self._waits: list[tuple[str, Callable[[Any], bool], Future]] = []
        for name in ('plan', 'map', 'diagnostics'):
            self.node.create_subscription(
                TOPICS[name].type,
                name,
                lambda message, name=name: self._hear(name, message),
                offered_qos(TOPICS[name]),
            )
        self.last: dict[str, Any] = {}
        self.wait(self._connected())

    def send(self, topic: str, message: Any) -> None:
        self._publishers[topic].publish(message)

    def expect(self, topic: str, accept: Callable[[Any], bool] = lambda message: True) -> Future:
        future = Future(executor=self.executor)
        self._waits.append((topic, accept, future))
        return future

    def wait(self, future: Future) -> Any:
        self.executor.spin_until_future_complete(future, WAIT_S)
        assert future.done()
        return future.result()

    def request(self, start: tuple[float, float], goal: tuple[float, float]) -> Future:
        message = GetPlan.Request(start=pose_message(*start, 0.0, 0), goal=pose_message(*goal, 0.0, 0))
        return self.client.call_async(message)

    def _hear(self, topic: str, message: Any) -> None:
        self.last[topic] = message
        for wait in [wait for wait in self._waits if wait[0] == topic and wait[1](message)]:
            self._waits.remove(wait)
            wait[2].set_result(message)

    def _connected(self) -> Future:
        future = Future(executor=self.executor)

        def look() -> None:
            heard = all(publisher.get_subscription_count() for publisher in self._publishers.values())
            if heard and self.client.service_is_ready() and not future.done():
                future.set_result(None)

        self.node.create_timer(0.05, look)
        return future


def basin() -> Harbour:
    return Harbour('basin', box(0, 0, 2000, 1000) - box(900, 300, 1100, 1001))


def odometry(x_m: float, y_m: float) -> Any:
    message = new_odometry(BODY_FRAME)
    fill_odometry(message, STAMP_NS, VesselState(x_m, y_m, 0.0))
    return message


def command(folder: Path, parameters: dict[str, Any]) -> tuple[str, ...]:
    file = folder / 'params.yaml'
    file.write_text(yaml.safe_dump({'global_planner': {'ros__parameters': parameters}}))
    return (
        sys.executable,
        '-m',
        'portnav_ros.nodes.global_planner',
        '--ros-args',
        '--params-file',
        str(file),
    )


@pytest.fixture(scope='module')
def chart(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp('chart') / 'chart.geojson'
    write_geojson(basin(), file)
    return file


@pytest.fixture(scope='module')
def planner(chart: Path) -> Iterator[subprocess.Popen[bytes]]:
    reader, writer = os.pipe()
    process = subprocess.Popen(
        command(chart.parent, PARAMETERS | {'chart': str(chart)}),
        env=os.environ
        | {
            'ROS_DOMAIN_ID': str(DOMAIN),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            STATUS_FD: str(writer),
        },
        pass_fds=(writer,),
    )
    os.close(writer)
    with os.fdopen(reader) as pipe:
        assert 'ready' in pipe.readline()
    yield process
    process.send_signal(signal.SIGINT)
    try:
        assert process.wait(WAIT_S) == 0
    finally:
        process.kill()


@pytest.fixture(scope='module')
def bridge(planner: subprocess.Popen[bytes]) -> Iterator[Bridge]:
    context = Context()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        rclpy.init(context=context, domain_id=DOMAIN)
        yield Bridge(context)
    context.try_shutdown()


def has_reason(reason: str, key: str = 'reason') -> Callable[[DiagnosticArray], bool]:
    return lambda message: any(read_values(status).get(key) == reason for status in message.status)


def expected_path(chart: Path, start: tuple[float, float], goal: tuple[float, float]) -> np.ndarray:
    params = RrtStarParams(**PARAMETERS['rrt_star'])
    return plan_route(read_chart(chart), start, goal, params, 20.0, PARAMETERS['seed'])


def test_the_map_is_latched(bridge: Bridge) -> None:
    grid = bridge.last.get('map') or bridge.wait(bridge.expect('map'))
    cells = np.array(grid.data).reshape(grid.info.height, grid.info.width)
    assert grid.header.frame_id == 'map'
    assert (cells == 0).sum() * grid.info.resolution**2 == pytest.approx(basin().water.area, rel=0.01)


def test_a_goal_is_answered_by_the_plan_made_in_process(bridge: Bridge, chart: Path) -> None:
    plan = bridge.expect(
        'plan', lambda message: len(message.poses) > 0 and message.poses[-1].pose.position.x > 1800
    )
    bridge.send('goal_pose', pose_message(*GOAL, 0.0, 0))
    bridge.send('odom', odometry(*START))
    message = bridge.wait(plan)
    np.testing.assert_array_equal(read_path(message), expected_path(chart, START, GOAL))
    assert message.header.stamp.sec == 1


def test_a_new_goal_pre_empts_the_old_one(bridge: Bridge) -> None:
    bridge.send('odom', odometry(*START))
    plan = bridge.expect(
        'plan', lambda message: len(message.poses) > 0 and message.poses[-1].pose.position.y == 120.0
    )
    for y in (100.0, 110.0, 120.0):
        bridge.send('goal_pose', pose_message(1800.0, y, 0.0, 0))
    assert bridge.wait(plan).poses[-1].pose.position.x == 1800.0


def test_several_goals_are_joined(bridge: Bridge) -> None:
    bridge.send('odom', odometry(*START))
    plan = bridge.expect(
        'plan', lambda message: len(message.poses) > 0 and message.poses[-1].pose.position.x == 600.0
    )
    bridge.send(
        'goal_poses',
        Goals(
            header=pose_message(0.0, 0.0, 0.0, 0).header,
            goals=[pose_message(1500.0, 500.0, 0.0, 0), pose_message(600.0, 600.0, 0.0, 0)],
        ),
    )
    path = read_path(bridge.wait(plan))
    assert [1500.0, 500.0] in path.tolist()
    assert np.hypot(*np.diff(path, axis=0).T).min() > 0.0


def test_a_goal_on_land_is_an_empty_plan_with_a_reason(bridge: Bridge) -> None:
    bridge.send('odom', odometry(*START))
    told = bridge.expect('diagnostics', has_reason('GOAL_OCCUPIED'))
    plan = bridge.expect('plan', lambda message: len(message.poses) == 0)
    bridge.send('goal_pose', pose_message(*LAND, 0.0, 0))
    bridge.wait(plan)
    bridge.wait(told)


def test_requests_are_answered_and_outlive_goals(bridge: Bridge, chart: Path) -> None:
    bridge.send('odom', odometry(*START))
    answers = [bridge.request(START, GOAL) for _ in range(3)]
    bridge.send('goal_pose', pose_message(*LAND, 0.0, 0))
    for answer in answers:
        np.testing.assert_array_equal(read_path(bridge.wait(answer).plan), expected_path(chart, START, GOAL))


@pytest.mark.parametrize(
    ('start', 'goal', 'reason'),
    [
        (LAND, GOAL, 'START_OCCUPIED'),
        (START, LAND, 'GOAL_OCCUPIED'),
        (START, (9999.0, 0.0), 'GOAL_OUTSIDE_MAP'),
        (START, (float('nan'), 0.0), 'INVALID_POSE'),
    ],
)
def test_a_request_that_fails_has_an_empty_path_and_a_reason(
    bridge: Bridge, start: tuple[float, float], goal: tuple[float, float], reason: str
) -> None:
    told = bridge.expect('diagnostics', has_reason(reason, 'request_reason'))
    assert not bridge.wait(bridge.request(start, goal)).plan.poses
    bridge.wait(told)


def test_a_request_says_nothing_of_the_plan_that_is_followed(bridge: Bridge) -> None:
    bridge.send('odom', odometry(*START))
    planned = bridge.expect('diagnostics', lambda message: message.status[0].message == 'planned')
    bridge.send('goal_pose', pose_message(*GOAL, 0.0, 0))
    bridge.wait(planned)
    told = bridge.expect('diagnostics', has_reason('GOAL_OCCUPIED', 'request_reason'))
    bridge.request(START, LAND)
    assert bridge.wait(told).status[0].message == 'planned'


def test_a_route_that_is_planned_anew_keeps_the_goals_ahead(bridge: Bridge) -> None:
    first, last = (1500.0, 500.0), (600.0, 600.0)
    poses = [pose_message(*goal, 0.0, 0) for goal in (first, last)]
    bridge.send('odom', odometry(*START))
    for topic, message in (
        ('goal_poses', Goals(header=poses[0].header, goals=poses)),
        ('goal_pose', poses[1]),
    ):
        plan = bridge.expect('plan', lambda message: path_ends_at(message, last))
        bridge.send(topic, message)
        assert list(first) in read_path(bridge.wait(plan)).tolist()


def test_goals_that_were_passed_are_not_ahead() -> None:
    path = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 100.0], [0.0, 100.0]])
    route = Route(path, ((100.0, 0.0), (100.0, 100.0), (0.0, 100.0)), (100.0, 200.0, 300.0))
    assert route.ahead((50.0, 3.0)) == [(100.0, 0.0), (100.0, 100.0), (0.0, 100.0)]
    assert route.ahead((97.0, 50.0)) == [(100.0, 100.0), (0.0, 100.0)]
    assert route.ahead((0.0, 103.0)) == [(0.0, 100.0)]
    assert route.leads_to((0.0, 100.1))
    assert not route.leads_to((100.0, 100.0))


def path_ends_at(message: Any, goal: tuple[float, float]) -> bool:
    return len(message.poses) > 0 and math.dist(read_path(message)[-1], goal) < 0.5


def test_a_pose_that_is_not_finite_is_refused_and_counted(bridge: Bridge) -> None:
    told = bridge.expect(
        'diagnostics',
        lambda message: any('refused_goal_pose' in read_values(status) for status in message.status),
    )
    bridge.send('goal_pose', pose_message(float('nan'), 0.0, 0.0, 0))
    bridge.wait(told)


def test_a_killed_planning_process_is_replaced(bridge: Bridge, planner: subprocess.Popen[bytes]) -> None:
    children = Path(f'/proc/{planner.pid}/task/{planner.pid}/children').read_text().split()
    descriptor = os.pidfd_open(int(children[0]))
    signal.pidfd_send_signal(descriptor, signal.SIGKILL)
    select.select([descriptor], [], [], WAIT_S)  # readable once the process has ended
    os.close(descriptor)
    assert bridge.wait(bridge.request(START, GOAL)).plan.poses


@pytest.mark.parametrize(
    ('parameters', 'complaint'),
    [({}, 'parameter chart is missing'), ({'chart': '/nowhere.geojson'}, '/nowhere.geojson')],
)
def test_a_chart_that_cannot_be_read_ends_the_node(
    tmp_path: Path, parameters: dict[str, Any], complaint: str
) -> None:
    result = subprocess.run(
        command(tmp_path, parameters or {'seed': 1}),
        env=os.environ | {'ROS_DOMAIN_ID': str(DOMAIN + 1), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'},
        capture_output=True,
        text=True,
        timeout=3.0 * WAIT_S,
    )
    assert result.returncode == 2
    assert complaint in result.stderr
