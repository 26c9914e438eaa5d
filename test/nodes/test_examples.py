"""Every example runs: the driver's template, VRX's adapter on its stand-in, the tools, and their files."""

import importlib.util
import math
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from sensor_msgs.msg import JointState, LaserScan
from std_msgs.msg import Float64

from portnav_ros.charts import read_chart
from portnav_ros.evaluation.driver.moves import NAMES
from portnav_ros.evaluation.driver.record import Expected
from portnav_ros.nodes.check_driver import examine
from portnav_ros.nodes.driver_probe import DriverProbe
from portnav_ros.nodes.messages import fill_joints, new_joints, new_odometry, path_message, read_pose
from portnav_ros.nodes.safety_monitor import SafetyMonitor
from portnav_ros.sim.difficulty import load_difficulty, load_vessel
from portnav_ros.sim.generator import find_scenario
from portnav_ros.types import Actuation

EXAMPLES = Path(__file__).parents[2] / 'examples'
SECOND_NS = 1_000_000_000


def load(name):
    specification = importlib.util.spec_from_file_location(name, EXAMPLES / f'{name}.py')
    module = importlib.util.module_from_spec(specification)
    sys.modules[name] = module
    specification.loader.exec_module(module)
    return module


template, adapter, stand_in = map(load, ('driver_template', 'vrx_adapter', 'vrx_stand_in'))
sender, switches = map(load, ('send_goal', 'emergency_stop'))


def command(time_ns, rudder_rad, thrust_n):
    message = new_joints()
    fill_joints(message, time_ns, Actuation(rudder_rad, thrust_n))
    return message


@pytest.mark.parametrize(('name', 'length_m', 'range_m'), [('workboat', 5.0, 150.0), ('vrx', 4.9, 130.0)])
def test_the_files_of_the_examples_can_be_read(name, length_m, range_m, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    difficulty = load_difficulty(EXAMPLES / f'{name}.yaml')
    assert load_vessel(difficulty.vessel).length_m == length_m
    assert difficulty.lidar.range_max_m == range_m
    scenario = find_scenario(str(EXAMPLES / f'{name}.yaml'), 0, None, EXAMPLES / 'basin.geojson')
    assert scenario.harbour.name == 'Basin'


def test_the_template_lives_in_the_basin_of_the_chart():
    harbour = read_chart(EXAMPLES / 'basin.geojson')
    grid = harbour.clearance(2.0, 'charted')
    vessel = template.Vessel()
    assert np.isfinite(vessel.sweep()).sum() > 100
    vessel.x, vessel.y = 50.0, -90.0
    middle = round((vessel.y - grid.y0_m) / 2.0), round((vessel.x - grid.x0_m) / 2.0)
    assert float(np.min(vessel.sweep())) == pytest.approx(float(grid.distance[middle]), abs=4.0)
    astern = template.Vessel()
    astern.x, astern.yaw = -100.0, 0.0
    assert float(astern.sweep()[0]) == pytest.approx(20.0)


@pytest.mark.parametrize('node_class', [template.Driver, adapter.VrxAdapter])
def test_half_a_command_is_refused(graph, node_class):
    node = graph.build(node_class)
    for names, position, effort in (
        (['rudder'], [0.1], [0.0]),
        (['rudder', 'sail'], [0.1, 0.0], [0.0, 1.0]),
        (['rudder', 'propulsion', 'bow'], [0.1, 0.0, 0.0], [0.0, 1.0, 0.0]),
        (['rudder', 'propulsion'], [0.1], []),
        (['rudder', 'propulsion'], [math.nan, 0.0], [0.0, 1.0]),
        (['rudder', 'propulsion'], [0.1, 0.0], [0.0, math.inf]),
    ):
        node.take_command(JointState(name=names, position=position, effort=effort))
    assert node.command == (0.0, 0.0)
    node.take_command(command(0, 0.1, 5.0))
    assert node.command == (0.1, 5.0)
    node.take_command(JointState(name=['propulsion', 'rudder'], position=[0.0, 0.2], effort=[7.0, 0.0]))
    assert node.command == (0.2, 7.0)


def test_a_command_with_an_old_stamp_is_worth_nothing(graph):
    driver = graph.build(template.Driver)
    driver.take_command(command(driver.now_ns() - 2 * SECOND_NS, 0.3, 1000.0))
    driver.tick()
    assert (driver.vessel.rudder, driver.vessel.thrust) == (0.0, 0.0)
    driver.take_command(command(driver.now_ns() + 60 * SECOND_NS, 0.3, 1000.0))
    assert driver.commanded_ns <= driver.now_ns()
    driver.tick()
    assert driver.vessel.rudder > 0.0
    assert driver.vessel.thrust > 0.0


def test_a_clock_that_steps_back_keeps_no_command_alive(graph, monkeypatch):
    driver = graph.build(template.Driver)
    driver.take_command(command(driver.now_ns(), 0.3, 1000.0))
    now_ns = driver.now_ns()
    monkeypatch.setattr(driver, 'now_ns', lambda: now_ns - 300 * SECOND_NS)
    driver.received_s -= 2.0
    driver.tick()
    assert (driver.vessel.rudder, driver.vessel.thrust) == (0.0, 0.0)


def test_the_adapter_leaves_no_thrust_when_the_odometry_ends(graph):
    driver, ordered = graph.build(adapter.VrxAdapter), []
    graph.other.create_subscription(Float64, 'wamv/thrusters/left/thrust', ordered.append, 10)
    graph.until(lambda: driver.thrusts[0].get_subscription_count(), 'a thruster')
    driver.take_odometry(new_odometry())
    driver.take_command(command(0, 0.0, 200.0))
    driver.take_odometry(new_odometry())
    graph.until(lambda: ordered and ordered[-1].data == 100.0, 'thrust')
    driver.heard_s -= 2.0
    driver.watch()
    graph.until(lambda: ordered[-1].data == 0.0, 'no thrust')


def test_the_adapter_begins_anew_with_the_simulation(graph):
    driver = graph.build(adapter.VrxAdapter)
    late = new_odometry()
    late.header.stamp.sec = 100
    driver.take_odometry(late)
    driver.take_command(command(100 * SECOND_NS, 0.0, 200.0))
    assert driver.obeying()
    driver.take_odometry(new_odometry())
    assert not driver.obeying()


def test_the_adapter_passes_on_the_stand_in_of_vrx(graph):
    world, driver = graph.build(stand_in.VrxStandIn), graph.build(adapter.VrxAdapter)
    probe = graph.build(DriverProbe)

    def spin_once(_):
        world.tick()
        end_s = time.monotonic() + 0.05
        while not served() and time.monotonic() < end_s:
            graph.executor.spin_once(0.005)

    def served():
        now_s = world.ticks * stand_in.PERIOD_S
        return math.isclose(probe.now_s, now_s) and math.isclose(driver.time_ns / SECOND_NS, now_s)

    difficulty = load_difficulty(EXAMPLES / 'vrx.yaml')
    expected = Expected(load_vessel(difficulty.vessel), difficulty.lidar)
    findings = {
        found.check: found for found in examine(probe, spin_once, 3.0, expected, 150.0, lambda line: None)
    }
    left_out = {name for name, finding in findings.items() if finding.status != 'ok'}
    assert left_out == {'targets', 'targets frame'}, [findings[name] for name in left_out]
    assert {findings[name].status for name in (*NAMES, 'twist', 'yaw rate')} == {'ok'}
    assert findings['~/enable'].found == '/vrx_adapter/enable'
    for _ in range(5):
        spin_once(0.0)
    assert set(world.thrust.values()) == {0.0}


def test_a_rudder_to_port_turns_the_pods_of_vrx_to_starboard(graph):
    driver, said = graph.build(adapter.VrxAdapter), []
    driver.angles = driver.thrusts = [type('Pod', (), {'publish': staticmethod(said.append)})] * 2
    driver.take_command(command(0, 0.2, 1e6))
    assert driver.drive() == (0.2, 500.0)
    assert said == [Float64(data=-0.2), Float64(data=250.0)] * 2


def test_sectors_hold_the_nearest_return_about_the_middle_of_the_hull():
    message = LaserScan(angle_min=-math.pi, angle_increment=math.pi / 4, range_min=0.5, range_max=100.0)
    message.ranges = [10.0, math.inf, 20.0, math.nan, 30.0, 200.0, 40.0, math.inf]
    ranges = adapter.sectors(message)
    to_starboard, to_port = (math.hypot(adapter.LIDAR_X_M, away) for away in (20.0, 40.0))
    assert sorted(ranges[np.isfinite(ranges)]) == pytest.approx(
        sorted([10.0 - adapter.LIDAR_X_M, to_starboard, 30.0 + adapter.LIDAR_X_M, to_port])
    )
    assert ranges[0] == pytest.approx(10.0 - adapter.LIDAR_X_M)  # astern
    assert ranges[90] == pytest.approx(30.0 + adapter.LIDAR_X_M)  # ahead
    assert ranges[46] == pytest.approx(to_starboard)  # 88 degrees, because the lidar stands ahead
    message.ranges = [1.0] * 8
    assert np.isneginf(adapter.sectors(message)[0])  # 0.3 m astern of the middle: too close


def test_a_goal_is_sent_until_a_plan_ends_there(graph):
    graph.listen('goal_pose')
    answer = sender.send(graph.other, 30.0, 40.0)
    assert read_pose(graph.last('goal_pose')) == (30.0, 40.0, 0.0)
    graph.publish('plan', path_message(np.array([[0.0, 0.0], [1.0, 1.0]]), 0))
    graph.publish('plan', path_message(np.array([[0.0, 0.0], [15.0, 20.0], [30.0, 40.0]]), 0))
    graph.until(answer.done)
    assert answer.result() == 3


@pytest.mark.parametrize('words', [[], ['1'], ['a', 'b'], ['1', '2', '3']])
def test_a_goal_is_two_numbers(monkeypatch, capsys, words):
    monkeypatch.setattr(sys, 'argv', ['send_goal.py', *words])
    assert sender.main() == 2
    assert 'X Y' in capsys.readouterr().err


def test_the_switch_stops_until_it_says_go(graph):
    switch = switches.Switch(graph.other)
    assert [switch.order(line) for line in ('\n', 'go\n', 'no\n')] == ['STOP', 'go', 'STOP']
    graph.add(SafetyMonitor)
    graph.listen('safety_state')
    graph.publish('odom', new_odometry())
    graph.last('safety_state', lambda state: state.message == 'stop: emergency stop')
    switch.order('go')
    graph.publish('odom', new_odometry())
    graph.last('safety_state', lambda state: 'emergency' not in state.message)
