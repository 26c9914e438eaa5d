"""Sim, planner, safety monitor and autopilot sail a port by the clock, faster than real time, to its end."""

import numpy as np

from portnav_ros.nodes.line_of_sight_planner import make_node as make_planner
from portnav_ros.nodes.messages import path_message, read_odometry, read_values
from portnav_ros.nodes.pid_controller import PidController
from portnav_ros.nodes.safety_monitor import SafetyMonitor
from portnav_ros.nodes.sim import Sim
from portnav_ros.sim.generator import load_scenario

POND = """
vessel: shuttle
water: [[0, -200], [700, -200], [700, 200], [0, 200]]
start: [100, 0, 0.3]
goal: [500, 60]
"""


def test_the_vessel_reaches_its_goal(graph, tmp_path):
    file = tmp_path / 'pond.yaml'
    file.write_text(POND)
    scenario = load_scenario(file, 0)
    graph.listen('odom', 'episode', 'goal_pose')
    patience = {'preset': scenario.vessel.name}
    graph.add(PidController, odom_age_s=60.0, setpoint_age_s=600.0, **patience)
    graph.add(SafetyMonitor, age_s=60.0, setpoint_age_s=600.0, **patience)
    graph.add(make_planner, age_s=60.0, **patience)
    sim = graph.add(Sim, scenario=str(file), rate=50.0, neutral_s=60.0)
    goal = graph.last('goal_pose').pose.position
    assert (goal.x, goal.y) == scenario.goal
    graph.publish('plan', path_message(scenario.path, 0))
    graph.until(lambda: not sim.running, 'the end of the episode')
    values = read_values(graph.last('episode', lambda status: status.message != 'RUNNING'))
    assert values['outcome'] == 'SUCCESS'
    end = read_odometry(graph.heard['odom'][-1])
    assert np.hypot(end.x_m - goal.x, end.y_m - goal.y) < scenario.goal_radius_m + 5.0
