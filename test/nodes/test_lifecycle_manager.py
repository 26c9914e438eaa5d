"""The manager: what it asks of whom, in which order, and what it does where no answer comes."""

import gc
import weakref
from itertools import pairwise

import pytest
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from portnav_ros.nodes import lifecycle_manager
from portnav_ros.nodes.lifecycle import ManagedNode
from portnav_ros.nodes.lifecycle_manager import ACTIVATE, CONFIGURE, DEACTIVATE, LifecycleManager, due
from portnav_ros.nodes.topics import TOPICS, offered_qos

NAMES = ('recorder', 'controller', 'driver')


@pytest.mark.parametrize(
    ('states', 'rising', 'expected'),
    [
        ('unconfigured unconfigured', True, {'a': CONFIGURE, 'b': CONFIGURE}),
        ('inactive unconfigured', True, {'b': CONFIGURE}),
        ('inactive unknown', True, {}),
        ('inactive inactive', True, {'a': ACTIVATE}),
        ('active inactive', True, {'b': ACTIVATE}),
        ('active active', True, {}),
        ('active active', False, {'b': DEACTIVATE}),
        ('active inactive', False, {'a': DEACTIVATE}),
        ('active unknown', False, {'a': DEACTIVATE}),
        ('inactive unconfigured', False, {}),
    ],
)
def test_what_is_due(states, rising, expected):
    assert due(dict(zip('ab', states.split(), strict=True)), rising) == expected


class Recording(ManagedNode):
    """A node that takes down its transitions in a list that it shares with others."""

    def __init__(self, name, story, **options):
        super().__init__(name, **options)
        self._story = story

    def configure(self):
        self._story.append((self.get_name(), 'configure'))

    def activate(self):
        self._story.append((self.get_name(), 'activate'))

    def deactivate(self):
        self._story.append((self.get_name(), 'deactivate'))


class Managed:
    """Three nodes, their manager, and somebody who listens to it."""

    def __init__(self, graph, monkeypatch):
        self.graph, self.story, self.told = graph, [], []
        self.pids = dict.fromkeys(NAMES, 1)
        self.nodes = {name: self.build(name) for name in NAMES}
        monkeypatch.setenv('ROS_DOMAIN_ID', str(graph.context.get_domain_id()))
        self.manager = LifecycleManager(NAMES)
        name = 'managed_nodes_activated'
        graph.other.create_subscription(
            Bool, name, lambda message: self.told.append(message.data), offered_qos(TOPICS[name])
        )

    def build(self, name):
        return self.graph.build(lambda **options: Recording(name, self.story, **options))

    def work(self):
        """Give the manager a moment."""
        return self.manager.step(self.pids, 0.005)

    def until(self, condition, what):
        """Let everybody work until a condition holds."""

        def worked():
            self.work()
            return condition()

        self.graph.until(worked, what)

    def rise(self):
        self.until(lambda: not self.manager.waits(self.pids), 'all to be active')


@pytest.fixture
def managed(graph, monkeypatch):
    managed = Managed(graph, monkeypatch)
    yield managed
    managed.manager.close()


def test_all_are_configured_then_activated_in_order_and_deactivated_in_reverse(managed):
    managed.rise()
    assert {step for _, step in managed.story[:3]} == {'configure'}
    assert managed.story[3:] == [(name, 'activate') for name in NAMES]
    managed.manager.begin_rest()
    managed.until(lambda: not managed.manager.waits(managed.pids), 'all to be inactive')
    assert managed.story[6:] == [(name, 'deactivate') for name in reversed(NAMES)]


def test_who_has_become_active_is_returned_once(managed):
    news = []
    managed.graph.until(lambda: news.extend(managed.work().items()) or len(news) >= 6)
    assert sorted(news) == sorted((name, active) for name in NAMES for active in (False, True))
    assert managed.work() == {}


def test_whether_all_are_active_is_told_and_latched(managed):
    managed.rise()
    managed.until(lambda: managed.told[-1:] == [True], 'the topic')
    client = managed.graph.other.create_client(Trigger, 'lifecycle_manager/is_active')
    managed.until(client.service_is_ready, 'the service')
    answer = client.call_async(Trigger.Request())
    managed.until(answer.done, 'an answer')
    assert (answer.result().success, 'driver active' in answer.result().message) == (True, True)


def test_a_node_that_came_back_is_led_up_again(managed):
    managed.rise()
    managed.until(lambda: managed.told[-1:] == [True], 'the topic')
    node = managed.nodes['controller']
    managed.graph.remove(node)
    managed.pids['controller'] = None
    managed.until(lambda: managed.told[-1] is False, 'the topic to tell of the loss')
    managed.story.clear()
    managed.build('controller')
    managed.pids['controller'] = 2
    managed.rise()
    assert managed.story == [('controller', 'configure'), ('controller', 'activate')]
    managed.until(lambda: managed.told[-1] is True, 'the topic')
    assert all(a != b for a, b in pairwise(managed.told)), 'only changes are told'


def test_the_rest_is_active_without_a_node_that_was_given_up(managed):
    managed.pids.pop('recorder')
    managed.rise()
    assert {name for name, _ in managed.story} == {'controller', 'driver'}


def test_where_no_answer_comes_the_state_is_read_again(managed, monkeypatch):
    monkeypatch.setattr(lifecycle_manager, 'ANSWER_S', 0.05)
    managed.rise()
    managed.manager.begin_rest()
    managed.graph.nodes.remove(node := managed.nodes['driver'])
    managed.graph.executor.remove_node(node)  # it hangs
    managed.until(lambda: 'driver' in managed.manager.behind(managed.pids), 'the time-out')
    assert managed.manager.behind(managed.pids) == {'driver': 'no answer to deactivate'}
    managed.until(lambda: len(managed.story) >= 8, 'the others, which do not wait for it')
    assert managed.story[6:8] == [('controller', 'deactivate'), ('recorder', 'deactivate')]
    managed.graph._take(node)
    managed.until(lambda: not managed.manager.behind(managed.pids), 'the state that was read')
    assert managed.story[8:] == [('driver', 'deactivate')]


def test_a_manager_that_was_closed_can_be_collected():
    manager = LifecycleManager(NAMES)
    manager.step({}, 0.001)
    manager.close()
    left = weakref.ref(manager)
    del manager
    gc.collect()
    assert left() is None, 'with it stay threads and memory of the middleware'
