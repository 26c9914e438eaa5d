"""The recorder as a process: what is published on the topics of the table is in the bag."""

import itertools
import json
import os
import signal
import subprocess
import sys
import time
from typing import NamedTuple

import pytest
import rclpy
import yaml
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from portnav_ros.evaluation.bags import read_bag
from portnav_ros.nodes import messages
from portnav_ros.nodes.bag_recorder import BagRecorder
from portnav_ros.nodes.status_pipe import STATUS_FD
from portnav_ros.nodes.topics import TOPICS, offered_qos
from portnav_ros.types import Actuation, VesselState

DOMAINS = itertools.count(52)
TICK_NS = 50_000_000
COUNT = 400


class Driver(NamedTuple):
    """A node that publishes, on a domain of its own: a killed recorder lingers in discovery."""

    node: Node
    executor: SingleThreadedExecutor
    domain: int


@pytest.fixture
def driver(monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    context, domain = Context(), next(DOMAINS)
    rclpy.init(context=context, domain_id=domain)
    node, executor = rclpy.create_node('driver', context=context), SingleThreadedExecutor(context=context)
    executor.add_node(node)
    yield Driver(node, executor, domain)
    context.try_shutdown()


STARTED: list[subprocess.Popen] = []


@pytest.fixture(autouse=True)
def _leave_no_process():
    yield
    for process in STARTED:
        process.kill()
        process.wait()
    STARTED.clear()


def start(tmp_path, domain: int = 51, remap: str = '', **parameters: object) -> subprocess.Popen:
    """Start a recorder and wait until it says that it is ready."""
    rules = ['-r', remap] if remap else []
    values = {'bag': str(tmp_path / 'bag'), 'lock_step': True} | parameters
    file = tmp_path / 'params.yaml'
    file.write_text(yaml.safe_dump({'bag_recorder': {'ros__parameters': values}}))
    reader, writer = os.pipe()
    process = subprocess.Popen(
        (
            sys.executable,
            '-m',
            'portnav_ros.nodes.bag_recorder',
            '--ros-args',
            '--params-file',
            str(file),
            *rules,
        ),
        env=os.environ | {'ROS_DOMAIN_ID': str(domain), STATUS_FD: str(writer)},
        pass_fds=(writer,),
        stderr=subprocess.PIPE,
        text=True,
    )
    STARTED.append(process)
    os.close(writer)
    with os.fdopen(reader) as pipe:
        ready = pipe.readline()
    assert 'ready' in ready, process.communicate()[1]
    return process


def publish(node, executor) -> None:
    """Publish a run of COUNT ticks once the recorder listens."""
    names = ('odom', 'cmd_actuators', 'episode')
    publishers = {
        name: node.create_publisher(TOPICS[name].type, name, offered_qos(TOPICS[name], lock_step=True))
        for name in names
    }
    heard: list[int] = []

    def hear(message) -> None:
        heard.extend(int(messages.read_values(status)['publishers']) for status in message.status)

    listener = node.create_subscription(TOPICS['diagnostics'].type, 'diagnostics', hear, 10)
    limit_s = time.monotonic() + 20.0
    while len(names) not in heard:
        assert time.monotonic() < limit_s, 'the recorder does not listen'
        executor.spin_once(timeout_sec=1.0)
    node.destroy_subscription(listener)
    odometry, joints = messages.new_odometry(), messages.new_joints()
    for tick in range(COUNT):
        messages.fill_odometry(odometry, tick * TICK_NS, VesselState(float(tick), 0.0, 0.0))
        publishers['odom'].publish(odometry)
        messages.fill_joints(joints, tick * TICK_NS, Actuation(0.0, float(tick)))
        publishers['cmd_actuators'].publish(joints)
    end = {'outcome': 'SUCCESS', 'stamp': COUNT * TICK_NS}
    publishers['episode'].publish(messages.status_message('episode', b'\0', '', end))
    for publisher in publishers.values():
        assert publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=10))
        node.destroy_publisher(publisher)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_what_is_published_is_recorded(tmp_path, driver, number):
    (tmp_path / 'run.json').write_text('{"seed": "7"}')
    (tmp_path / 'mine.geojson').write_text('{}')
    process = start(
        tmp_path, driver.domain, run_file=str(tmp_path / 'run.json'), chart=str(tmp_path / 'mine.geojson')
    )
    publish(driver.node, driver.executor)
    process.send_signal(number)
    assert process.wait(timeout=20.0) == 0, process.communicate()[1]
    bag = read_bag(tmp_path)
    assert not bag.lost
    assert bag.metadata == {'seed': '7'}
    assert [stamp for stamp, _ in bag.messages['/odom']] == [k * TICK_NS for k in range(COUNT)]
    efforts = [message.effort[1] for _, message in bag.messages['/cmd_actuators']]
    assert efforts == list(range(COUNT - 1)), 'all but the answer to the last odometry'
    assert len(bag.messages['/episode']) == 1
    assert (tmp_path / 'bag' / 'chart.geojson').exists()


def test_the_bag_tells_of_a_topic_that_was_remapped(tmp_path, driver):
    process = start(tmp_path, driver.domain, remap='episode:=ship/voyage')
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=20.0) == 0, process.communicate()[1]
    assert json.loads(read_bag(tmp_path).metadata['renamed']) == {'/ship/voyage': 'episode'}


@pytest.mark.parametrize('storage', ['sqlite3', 'mcap'])
def test_a_killed_recorder_leaves_a_readable_bag(tmp_path, driver, storage):
    process = start(tmp_path, driver.domain, storage=storage, lock_step=False)
    publish(driver.node, driver.executor)
    limit_s = time.monotonic() + 20.0
    while sum(file.stat().st_size for file in (tmp_path / 'bag').iterdir()) < 100_000:
        assert time.monotonic() < limit_s, 'nothing is written'
    process.kill()
    process.wait()
    bag = read_bag(tmp_path)
    read = [stamp for stamp, _ in bag.messages['/odom']]
    assert read == [k * TICK_NS for k in range(len(read))]
    assert len(read) >= 100
    assert bag.lost


def test_a_bag_that_is_there_is_not_overwritten(tmp_path):
    (tmp_path / 'bag').mkdir()
    with pytest.raises(AssertionError, match='exists already'):
        start(tmp_path)


def test_a_recorder_that_is_configured_again_begins_another_bag(graph, tmp_path):
    node = graph.add(BagRecorder, bag=str(tmp_path / 'bag'))
    odometry = messages.new_odometry()

    def heard():
        graph.publish('odom', odometry)
        return node._complete_ns

    for stamp_ns in (TICK_NS, 2 * TICK_NS):
        messages.fill_odometry(odometry, stamp_ns, VesselState(0.0, 0.0, 0.0, 3.0))
        graph.until(heard, 'the odometry')
        for transition in ('deactivate', 'cleanup', 'configure', 'activate'):
            getattr(node, f'trigger_{transition}')()
        assert node.state == 'active', node.failure
    for name, stamp_ns in (('bag', TICK_NS), ('bag-2', 2 * TICK_NS)):
        bag = read_bag(tmp_path / name)
        assert not bag.lost
        assert {stamp for stamp, _ in bag.messages['/odom']} == {stamp_ns}


def test_an_unknown_parameter_is_refused(tmp_path):
    with pytest.raises(AssertionError, match=r"unknown key 'storrage'; did you mean 'storage'"):
        start(tmp_path, storrage='mcap')
