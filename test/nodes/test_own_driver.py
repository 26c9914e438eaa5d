"""A driver of its own in place of the sim, started as a user does: sails to a goal and leaves a whole bag."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

from portnav_ros.evaluation.bag_episode import read_episode
from portnav_ros.nodes.topics import TOPICS, asked_qos
from portnav_ros.types import Outcome

EXAMPLES = Path(__file__).parents[2] / 'examples'
DOMAIN, WAIT_S = 64, 240.0
UP = (
    *('-m', 'portnav_ros', 'up', '--without', 'sim', '--planner', 'line_of_sight', '--real-time'),
    *('--chart', str(EXAMPLES / 'basin.geojson'), '--difficulty', str(EXAMPLES / 'workboat.yaml')),
)


@pytest.fixture
def start(monkeypatch):
    """Start a Python process of the graph; whatever is left of it ends with the test."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(DOMAIN))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    processes = []

    def begin(*words):
        processes.append(subprocess.Popen((sys.executable, *words), env=dict(os.environ)))
        return processes[-1]

    yield begin
    for process in processes:
        if process.poll() is None:
            process.kill()
        process.wait()


def wait_until_told(text):
    """Listen to the local planner until it says so."""
    context = Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    node, executor, said = (
        rclpy.create_node('listener', context=context),
        SingleThreadedExecutor(context=context),
        [],
    )
    row = TOPICS['navigation_state']
    node.create_subscription(row.type, row.name, lambda message: said.append(message.message), asked_qos(row))
    executor.add_node(node)
    end_s = time.monotonic() + WAIT_S
    while text not in said and time.monotonic() < end_s:
        executor.spin_once(0.1)
    node.destroy_node()
    context.try_shutdown()
    assert text in said


def test_a_driver_that_only_speaks_the_contract_sails_to_a_goal(start, tmp_path):
    driver = start(str(EXAMPLES / 'driver_template.py'))
    graph = start(*UP, '--out', str(tmp_path))
    assert start(str(EXAMPLES / 'send_goal.py'), '30', '20').wait(WAIT_S) == 0
    wait_until_told('stop: goal reached')
    graph.send_signal(signal.SIGINT)
    assert graph.wait(WAIT_S) == 128 + signal.SIGINT
    assert driver.poll() is None
    driver.send_signal(signal.SIGTERM)
    assert driver.wait(WAIT_S) == 0
    log = read_episode(tmp_path)
    assert log.outcome is Outcome.SUCCESS
    assert log.goal == pytest.approx((30.0, 20.0), abs=1.0)
