"""The table of topics against the contract."""

import pytest
from rclpy.qos import DurabilityPolicy, QoSCompatibility, ReliabilityPolicy, qos_check_compatible

from portnav_ros.nodes.topics import TOPICS, asked_qos, offered_qos

LATCHED = {'map', 'plan', 'navigation_state', 'episode', 'safety_state', 'managed_nodes_activated'}


@pytest.mark.parametrize('topic', TOPICS.values(), ids=TOPICS)
@pytest.mark.parametrize('lock_step', [False, True])
def test_both_ends_of_a_topic_match(topic, lock_step):
    compatibility, reason = qos_check_compatible(offered_qos(topic, lock_step), asked_qos(topic, lock_step))
    assert compatibility != QoSCompatibility.ERROR, reason


@pytest.mark.parametrize('topic', TOPICS.values(), ids=TOPICS)
def test_any_driver_matches(topic):
    asked = asked_qos(topic)
    assert not topic.name.startswith('/')
    if topic.name not in LATCHED:
        assert asked.reliability == ReliabilityPolicy.BEST_EFFORT
        assert asked.durability == DurabilityPolicy.VOLATILE


def test_who_comes_late_gets_states_and_plans():
    assert {name for name, topic in TOPICS.items() if topic.latched} == LATCHED
    for name in LATCHED:
        assert offered_qos(TOPICS[name]).durability == DurabilityPolicy.TRANSIENT_LOCAL
        assert offered_qos(TOPICS[name]).depth == 1


def test_nothing_that_holds_wall_time_is_recorded():
    assert not TOPICS['diagnostics'].recorded
    assert all(TOPICS[name].recorded for name in ('odom', 'scan', 'plan', 'setpoint', 'cmd_actuators'))
