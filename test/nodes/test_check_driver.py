"""The check of drivers through ROS: the sim, the template as it stands, and with one thing broken."""

import importlib.util
import json
import sys
import time
from pathlib import Path

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, LaserScan
from std_srvs.srv import Trigger

from portnav_ros import cli
from portnav_ros.evaluation.driver.moves import NAMES
from portnav_ros.evaluation.driver.record import Expected
from portnav_ros.nodes import check_driver
from portnav_ros.nodes.check_driver import examine, table
from portnav_ros.nodes.driver_probe import DriverProbe
from portnav_ros.nodes.sim import Sim
from portnav_ros.sim.difficulty import load_vessel
from portnav_ros.sim.generator import load_scenario
from portnav_ros.sim.scenario import LidarParams

EXAMPLES = Path(__file__).parents[2] / 'examples'
SECONDS, ROOM_M = 3.0, 200.0
TICK_WALL_S = 0.05  # patience with the delivery of one tick, while nodes still find each other


def load(name):
    specification = importlib.util.spec_from_file_location(name, EXAMPLES / f'{name}.py')
    module = importlib.util.module_from_spec(specification)
    sys.modules[name] = module
    specification.loader.exec_module(module)
    return module


TEMPLATE = load('driver_template')


class FastDriver(TEMPLATE.Driver):
    """The template in a time of its own, which it publishes and which a test advances."""

    def __init__(self, **options):
        super().__init__(**options)
        self.clock = self.create_publisher(Clock, 'clock', 1)

    def now_ns(self):
        return 50_000_000 * self.ticks

    def tick(self):
        super().tick()
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(self.now_ns(), 10**9)
        self.clock.publish(message)


class Spin:
    """Serves a graph: at each call the driver's time goes on by one tick, and the probe hears of it."""

    def __init__(self, graph, probe, driver, interrupt=None):
        self.graph, self.probe, self.driver, self.interrupt = graph, probe, driver, interrupt

    def __call__(self, _):
        if self.interrupt and self.interrupt(self.driver):
            self.interrupt = None
            raise KeyboardInterrupt
        self.driver.tick()
        end_s = time.monotonic() + TICK_WALL_S
        while round(self.probe.now_s * 1e9) != self.driver.now_ns() and time.monotonic() < end_s:
            self.graph.executor.spin_once(0.005)


def check(graph, driver_class, move=False, interrupt=None, **options):
    driver = graph.build(lambda **given: driver_class(**given, **options))
    probe = graph.build(lambda **given: DriverProbe(**given, **options))
    expected = Expected(load_vessel('workboat'), LidarParams(range_max_m=150.0))
    spin = Spin(graph, probe, driver, interrupt)
    said = []
    try:
        findings = examine(probe, spin, SECONDS, expected, ROOM_M if move else None, said.append)
    except KeyboardInterrupt:
        findings = []
    return {finding.check: finding for finding in findings}, driver, said


def failed(findings):
    return {name for name, finding in findings.items() if finding.status == 'fail'}


def test_the_sim_passes_in_motion(graph):
    scenario = load_scenario('crossing', 0)
    graph.add(Sim, scenario='crossing', hold_until_plan=False, rate=20.0)
    probe = graph.build(DriverProbe)
    expected = Expected(scenario.vessel, scenario.lidar)
    findings = examine(probe, graph.executor.spin_once, SECONDS, expected, ROOM_M, lambda line: None)
    statuses = {finding.check: finding.status for finding in findings}
    assert 'fail' not in statuses.values(), [finding for finding in findings if finding.status == 'fail']
    assert {statuses[name] for name in (*NAMES, 'targets', '~/enable', 'odom rate', 'odom stamps')} == {'ok'}


def test_the_template_passes_in_motion(graph):
    findings, driver, said = check(graph, FastDriver, move=True)
    left_out = {name for name, finding in findings.items() if finding.status != 'ok'}
    assert left_out == {'targets', 'targets frame'}, [findings[name] for name in left_out]
    assert len(said) == 8
    assert driver.enabled
    assert driver.command == (0.0, 0.0)


def test_without_move_nothing_is_commanded(graph):
    findings, driver, said = check(graph, FastDriver)
    assert not failed(findings)
    assert {findings[name].status for name in NAMES} == {'left out'}
    assert driver.commanded_ns < 0
    assert said == []


class Choosy(FastDriver):
    """Asks for commands that are kept for late joiners."""

    def __init__(self, **options):
        super().__init__(**options)
        for subscription in list(self.subscriptions):
            if subscription.topic_name.endswith('cmd_actuators'):
                self.destroy_subscription(subscription)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(JointState, 'cmd_actuators', self.take_command, latched)


class Doubled(FastDriver):
    """A second publisher of scan."""

    def __init__(self, **options):
        super().__init__(**options)
        self.other = self.create_publisher(LaserScan, 'scan', 5)


class OtherService(FastDriver):
    """A service of another type."""

    def __init__(self, **options):
        super().__init__(**options)
        for service in list(self.services):
            if service.service_name.endswith('/enable'):
                self.destroy_service(service)
        self.create_service(Trigger, '~/enable', lambda request, response: response)


class OtherNames(FastDriver):
    """Feedback with names of its own."""

    def feedback(self):
        message = super().feedback()
        message.name = ['helm', 'engine']
        return message


class OtherFrame(FastDriver):
    """Odometry in another frame."""

    def odometry(self):
        message = super().odometry()
        message.header.frame_id = 'odom'
        return message


class Sparse(FastDriver):
    """A scan at 2 Hz, and half the rays."""

    def sweep(self):
        message = super().sweep()
        message.ranges = message.ranges[::2]
        return message

    def tick(self):
        self.scan, scan = (self.scan, None) if self.ticks % 10 == 0 else (Nobody(), self.scan)
        super().tick()
        self.scan = scan or self.scan


class Nobody:
    """A publisher that does nothing."""

    def publish(self, message):
        pass


@pytest.mark.parametrize(
    ('driver_class', 'checks'),
    [
        (Choosy, {'cmd_actuators'}),
        (Doubled, {'scan'}),
        (OtherService, {'~/enable'}),
        (OtherNames, {'joint names'}),
        (OtherFrame, {'odom frame'}),
        (Sparse, {'scan rate', 'rays'}),
    ],
)
def test_a_broken_driver_is_not_moved(graph, driver_class, checks):
    findings, driver, said = check(graph, driver_class, move=True)
    assert failed(findings) == checks, [findings[name] for name in failed(findings)]
    assert all(findings[name].mend for name in checks)
    assert {findings[name].status for name in NAMES} == {'left out'}
    assert driver.commanded_ns < 0
    assert said == []


class Reversed(FastDriver):
    """Rudder the wrong way."""

    def take_command(self, message):
        super().take_command(message)
        self.command = -self.command[0], self.command[1]


class Stubborn(FastDriver):
    """Holds the last command for ever."""

    def tick(self):
        if self.commanded_ns >= 0:
            self.commanded_ns = self.now_ns()
        super().tick()


@pytest.mark.parametrize(('driver_class', 'name'), [(Reversed, 'rudder'), (Stubborn, 'neutral')])
def test_moves_show_what_rest_does_not(graph, driver_class, name):
    findings, _, _ = check(graph, driver_class, move=True)
    assert failed(findings) == {name}, [findings[name] for name in failed(findings)]


def test_a_namespace_is_followed(graph):
    findings, _, _ = check(graph, FastDriver, namespace='/boat')
    assert not failed(findings)
    assert findings['~/enable'].found == '/boat/driver/enable'


def test_nobody_moves_a_vessel_that_the_stack_commands(graph):
    def commanding(**options):
        driver = FastDriver(**options)
        driver.create_publisher(JointState, 'cmd_actuators', 1)
        return driver

    findings, driver, _ = check(graph, commanding, move=True)
    assert not failed(findings)
    assert 'end the stack first' in findings['rudder'].found
    assert driver.commanded_ns < 0


def test_an_interruption_leaves_neutral_commands(graph):
    findings, driver, _ = check(
        graph,
        FastDriver,
        move=True,
        interrupt=lambda driver: driver.command[1] > 0.0 and driver.vessel.thrust > 0,
    )
    assert findings == {}
    assert driver.command == (0.0, 0.0)


def test_leaving_the_room_ends_the_moves(graph, monkeypatch):
    monkeypatch.setattr(sys.modules[__name__], 'ROOM_M', 1.0)
    findings, driver, said = check(graph, FastDriver, move=True)
    assert 'left its room' in said[-1]
    assert {findings[name].status for name in ('rudder', 'neutral')} == {'left out'}
    assert driver.command == (0.0, 0.0)


def test_without_a_driver_the_command_fails_and_says_so(monkeypatch, tmp_path, capfd):
    monkeypatch.setenv('ROS_DOMAIN_ID', '48')
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    monkeypatch.setattr(check_driver, 'DISCOVERY_S', 0.2)
    file = tmp_path / 'findings.json'
    assert cli.main(['check-driver', '--seconds', '1', '--json', str(file)]) == 1
    printed = capfd.readouterr().out
    assert 'nobody publishes it' in printed
    assert 'ROS_DOMAIN_ID' in printed
    found = {row['check']: row for row in json.loads(file.read_text(encoding='utf-8'))}
    assert found['odom']['status'] == 'fail'
    assert found['rudder']['status'] == 'left out'


@pytest.mark.parametrize(
    'options',
    [
        ['--seconds', '0'],
        ['--room', '-1'],
        ['--difficulty', 'nowhere'],
        ['--move'],
        ['--json', 'no_folder/a.json'],
        ['--seconds', '1'],  # the domain alone is wrong
    ],
)
def test_mistakes_in_the_options(options, monkeypatch, capsys):
    monkeypatch.setenv('ROS_DOMAIN_ID', 'one')
    assert cli.main(['check-driver', *options]) == 2
    assert 'portnav: error' in capsys.readouterr().err


def test_the_table_counts():
    from portnav_ros.evaluation.driver.record import Finding

    lines = list(table([Finding('odom', 'ok', 'there'), Finding('scan', 'fail', 'gone', 'publish it')]))
    assert '-> publish it' in lines[2]
    assert lines[-1].endswith('1 passed, 1 failed, 0 left out')
