"""An emergency stop outlives the safety monitor: a new one knows of it before it is activated."""

import pytest
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from portnav_ros.nodes.lifecycle_manager import LifecycleManager
from portnav_ros.nodes.messages import new_odometry, read_values
from portnav_ros.nodes.safety_monitor import SafetyMonitor
from portnav_ros.nodes.topics import TOPICS, offered_qos

MONITOR = 'safety_monitor'


class Monitor(SafetyMonitor):
    """Takes down what it knows of orders when it is activated."""

    def activate(self):
        super().activate()
        self.activated_under = self._orders.by


class Bringup:
    """A manager, and the safety monitor that it leads; time passes by steps."""

    def __init__(self, graph):
        self.graph, self.pid = graph, None
        graph.listen('safety_state')
        self.manager = LifecycleManager((MONITOR,))

    def until(self, condition, what='the condition'):
        def worked():
            self.manager.step({MONITOR: self.pid}, 0.005)
            return condition()

        self.graph.until(worked, what)

    def start(self):
        """Lead a new monitor up, and return it."""
        self.node = self.graph.build(Monitor, zones=False)
        self.pid = id(self.node)
        self.until(lambda: not self.manager.waits({MONITOR: self.pid}), 'the monitor to be active')
        return self.node

    def die(self):
        self.graph.remove(self.node)
        self.pid = None

    def publish(self, data):
        self.graph.publish('emergency_stop', Bool(data=data))
        self.until(lambda: ('topic' in self.manager._standing._orders.by) is data, 'the order')

    def call(self, data):
        """Order by the service; returns once the monitor's state has told the manager."""
        self.graph.call(SetBool, f'{MONITOR}/emergency_stop', data=data)
        self.until(lambda: ('service' in self.manager._standing._orders.by) is data, 'the state')


@pytest.fixture
def bringup(graph, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(graph.context.get_domain_id()))
    bringup = Bringup(graph)
    yield bringup
    bringup.manager.close()


@pytest.mark.parametrize('order', [Bringup.call, Bringup.publish], ids=['service', 'topic'])
def test_a_monitor_that_is_started_again_stops_before_it_is_activated(graph, bringup, order):
    assert bringup.start().activated_under == ''
    order(bringup, True)
    bringup.die()
    assert 'service' in bringup.start().activated_under
    graph.heard['safety_state'].clear()
    graph.publish('odom', new_odometry())
    graph.last('safety_state', lambda state: state.message == 'stop: emergency stop')


def test_an_order_by_the_topic_counts_while_there_is_no_monitor(bringup):
    bringup.start()
    bringup.die()
    bringup.publish(True)
    assert 'service' in bringup.start().activated_under


def test_a_stop_that_outlived_two_monitors_ends_with_its_release(bringup):
    bringup.start()
    bringup.call(True)
    bringup.die()
    bringup.start()
    bringup.die()
    assert bringup.start().activated_under == 'service'
    bringup.call(False)
    bringup.die()
    assert bringup.start().activated_under == ''


def test_the_state_tells_by_which_way_a_stop_was_ordered_before_there_is_odometry(graph, bringup):
    bringup.start()
    bringup.call(True)
    state = graph.last('safety_state', lambda state: state.message == 'no odom yet')
    assert read_values(state)['emergency_stop_by'] == 'service'


def test_the_manager_hears_orders_where_the_nodes_do(graph, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(graph.context.get_domain_id()))
    order = graph.other.create_publisher(Bool, 'bridge/stop', offered_qos(TOPICS['emergency_stop']))
    remaps = ('odom:=ship/odometry', f'{MONITOR}:emergency_stop:=bridge/stop')
    manager = LifecycleManager((MONITOR,), remaps=remaps)

    def heard():
        order.publish(Bool(data=True))
        manager.step({MONITOR: None}, 0.005)
        return manager._standing.in_force

    graph.until(heard, 'the order')
    manager.close()
