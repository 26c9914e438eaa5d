"""What the doctor says of a graph: of one made up for each fault, and of two nodes that run."""

import json
from collections import Counter
from concurrent.futures import ThreadPoolExecutor

import pytest
from rclpy.qos import qos_profile_sensor_data

from portnav_ros import cli
from portnav_ros.nodes import graph_doctor
from portnav_ros.nodes.dwa_planner import make_node as make_dwa
from portnav_ros.nodes.graph_doctor import look
from portnav_ros.nodes.graph_findings import Graph, Status, judge, judge_graph
from portnav_ros.nodes.pid_controller import PidController
from portnav_ros.nodes.qos_match import End, Ends
from portnav_ros.nodes.topics import TOPICS

NODES = ('bag_recorder', 'pid_controller', 'safety_monitor', 'dwa_planner', 'global_planner', 'sim')
SPEAKS = {
    'odom': 'sim',
    'scan': 'sim',
    'joint_states': 'sim',
    'clock': 'sim',
    'plan': 'global_planner',
    'map': 'global_planner',
    'setpoint_raw': 'dwa_planner',
    'setpoint': 'safety_monitor',
    'cmd_actuators': 'pid_controller',
}
LISTENS = {
    'pid_controller': ('odom', 'setpoint'),
    'safety_monitor': ('odom', 'scan', 'setpoint_raw'),
    'dwa_planner': ('odom', 'scan', 'joint_states', 'plan'),
    'global_planner': ('odom',),
    'sim': ('cmd_actuators', 'plan'),
    'bag_recorder': ('odom', 'scan', 'plan', 'setpoint_raw', 'setpoint', 'cmd_actuators'),
}
HZ = {
    'odom': 20.0,
    'scan': 10.0,
    'joint_states': 20.0,
    'setpoint_raw': 1.0,
    'setpoint': 1.0,
    'cmd_actuators': 20.0,
}


def end(topic, node, **qos):
    row = TOPICS[topic]
    kind = f'{row.type.__module__.partition(".")[0]}/msg/{row.type.__name__}'
    return End(node, **{'reliable': True, 'latched': row.latched, 'type': kind} | qos)


def status(node, level=0, message='ok', **values):
    told = {'state': 'active', 'overruns': '0', 'calls': '200', 'stop_reason': ''}
    for topic in LISTENS[node]:
        told[f'{topic}_age_s'] = '40.000' if topic == 'plan' else '0.020'
        told[f'{topic}_behind_s'] = '0.000'
        if topic in HZ:
            told[f'{topic}_hz'] = str(HZ[topic])
    return Status(level, message, told | {key: str(value) for key, value in values.items()})


def well():
    """A graph of which nothing is to be said."""
    topics = {
        topic: Ends(
            (end(topic, speaker),),
            tuple(end(topic, node, reliable=False) for node in NODES if topic in LISTENS[node]),
        )
        for topic, speaker in SPEAKS.items()
    }
    statuses = {node: status(node) for node in NODES}
    statuses['sim'] = status('sim', outcome='RUNNING', achieved_rate=1.0)
    return Graph('/', NODES, topics, statuses)


def saying(graph, node, **changes):
    """The graph, with other diagnostics of a node."""
    return graph._replace(statuses=graph.statuses | {node: status(node, **changes)})


def joined(graph, topic, publishers=None, subscribers=None):
    """The graph, with other ends of a topic."""
    ends = graph.ends(topic)
    ends = Ends(
        ends.publishers if publishers is None else publishers,
        ends.subscribers if subscribers is None else subscribers,
    )
    return graph._replace(topics=graph.topics | {topic: ends})


def wrong(graph):
    return [finding for finding in judge_graph(graph) if finding.status != 'ok']


def only(graph):
    """The one thing that is wrong."""
    (finding,) = wrong(graph)
    assert finding.mend
    return finding


def test_of_a_graph_that_is_well_every_node_is_named_and_nothing_else():
    findings = judge_graph(well())
    assert Counter(finding.check for finding in findings) == Counter(NODES)
    assert {finding.status for finding in findings} == {'ok'}


def test_no_graph_is_told_with_the_place():
    (finding,) = judge([], 'ROS domain 7')
    assert (finding.status, 'ROS domain 7' in finding.found) == ('fail', True)
    assert 'portnav up' in finding.mend


def test_a_sensor_that_nobody_publishes():
    graph = joined(well(), 'scan', publishers=())
    finding = only(saying(graph, 'dwa_planner', level=0, scan_age_s='inf', scan_hz='0.0'))
    assert (finding.check, finding.status) == ('scan', 'fail')
    assert 'nobody publishes it; listening: dwa_planner, safety_monitor' in finding.found
    assert 'start the driver' in finding.mend


def test_nobody_obeys():
    finding = only(joined(well(), 'cmd_actuators', subscribers=(end('cmd_actuators', 'bag_recorder'),)))
    assert (finding.check, finding.status) == ('cmd_actuators', 'fail')
    assert 'start the driver' in finding.mend


def test_a_missing_node_is_told_by_what_it_should_say():
    graph = joined(well(), 'setpoint', publishers=())
    nodes = tuple(node for node in NODES if node != 'safety_monitor')
    statuses = {node: graph.statuses[node] for node in nodes}
    graph = joined(graph, 'setpoint_raw', subscribers=())._replace(nodes=nodes, statuses=statuses)
    assert [(finding.check, finding.mend.partition(';')[0]) for finding in wrong(graph)] == [
        ('setpoint_raw', 'start `portnav run safety_monitor`'),
        ('setpoint', 'start `portnav run safety_monitor`'),
    ]
    assert all('hangs' in finding.mend for finding in wrong(graph))


def test_messages_that_do_not_arrive():
    finding = only(saying(well(), 'dwa_planner', scan_age_s='inf', scan_hz='0.0'))
    assert (finding.check, finding.status) == ('scan', 'fail')
    assert 'dwa_planner has heard nothing of it from sim' in finding.found


def test_messages_that_are_too_old():
    finding = only(saying(well(), 'safety_monitor', scan_age_s='3.2', scan_hz='0.0'))
    assert finding.found == 'safety_monitor has heard none for 3.2 s, and may wait 0.5 s'
    assert finding.mend == 'see sim'


def test_stamps_of_another_clock():
    finding = only(saying(well(), 'dwa_planner', scan_behind_s='1.7'))
    assert (finding.check, 'its stamps are 1.7 s behind' in finding.found) == ('scan', True)
    assert 'let sim stamp by the same clock' in finding.mend


def test_a_rate_below_the_contracts_least():
    finding = only(saying(well(), 'dwa_planner', scan_hz='3.1'))
    assert (finding.check, finding.status) == ('scan', 'warn')
    assert finding.found == 'dwa_planner hears 3.1 Hz of at least 5 Hz'


def test_a_slow_simulation_may_send_less_often():
    graph = saying(well(), 'dwa_planner', scan_hz='3.1', scan_age_s='0.8')
    assert wrong(graph)
    assert not wrong(saying(graph, 'sim', outcome='RUNNING', achieved_rate=0.5))


@pytest.mark.parametrize(
    'sim', [{'message': 'waiting for a plan', 'outcome': 'RUNNING'}, {'outcome': 'SUCCESS'}]
)
def test_while_the_world_stands_still_nothing_is_too_old(sim):
    graph = saying(well(), 'dwa_planner', scan_hz='0.0', scan_age_s='9.0', odom_age_s='inf')
    assert not wrong(saying(graph, 'sim', **sim))


def test_without_a_goal_no_plan_is_missed():
    graph = saying(well(), 'dwa_planner', level=1, message='stop: no plan', plan_age_s='inf')
    finding = only(saying(graph, 'global_planner', message='no goal yet'))
    assert (finding.check, finding.status) == ('dwa_planner', 'warn')
    assert 'send a goal' in finding.mend
    assert 'plan' in [found.check for found in wrong(saying(graph, 'global_planner', message='planned'))]


def test_refused_messages_and_why():
    finding = only(
        saying(
            well(), 'dwa_planner', refused_scan=12, refused_scan_reason='90 rays, expected 180 (lidar.rays)'
        )
    )
    assert (finding.check, finding.status) == ('scan', 'warn')
    assert 'dwa_planner has refused 12 since activation, the last because: 90 rays' in finding.found
    assert finding.mend == 'mend sim'


def test_a_qos_that_does_not_match_is_named_once_with_both_ends():
    weak = (end('scan', 'driver', reliable=False),)
    graph = joined(well(), 'scan', weak, (end('scan', 'dwa_planner'), end('scan', 'pid', reliable=False)))
    finding = only(saying(graph, 'dwa_planner', scan_age_s='inf'))
    assert finding.found == 'dwa_planner does not hear driver: incompatible QoS (RELIABILITY)'
    assert '-p qos_overrides./scan.subscription.reliability:=best_effort' in finding.mend


def test_a_node_that_listens_twice_hears_by_either():
    publishers = (end('emergency_stop', 'switch'),)
    both = tuple(end('emergency_stop', 'safety_monitor', latched=latched) for latched in (True, False))
    assert not wrong(joined(well(), 'emergency_stop', publishers, both))
    assert only(joined(well(), 'emergency_stop', publishers, both[:1])).check == 'emergency_stop'


def test_a_publisher_that_offers_less_than_the_table_asks_is_named_without_a_listener():
    finding = only(joined(well(), 'map', (end('map', 'map_server', latched=False),), ()))
    assert finding.found == 'the stack does not hear map_server: incompatible QoS (DURABILITY)'


def test_another_type_is_named():
    finding = only(joined(well(), 'odom', (end('odom', 'driver', type='geometry_msgs/msg/PoseStamped'),), ()))
    assert finding.found == 'the stack does not hear driver: another type (TYPE)'
    assert finding.mend == 'publish nav_msgs/msg/Odometry'


def test_callbacks_that_take_too_long():
    figures = {'loop': 'scan', 'loop_p50_ms': 2.0, 'loop_p95_ms': 180.0, 'loop_max_ms': 250.0}
    finding = only(saying(well(), 'dwa_planner', overruns=20, calls=200, **figures))
    assert (finding.check, finding.status) == ('dwa_planner is slow', 'warn')
    assert '20 of its last 200 calls' in finding.found
    assert 'scan: p50 2.0 ms, p95 180.0 ms' in finding.found
    assert not wrong(saying(well(), 'dwa_planner', overruns=5, calls=200, **figures))


@pytest.mark.parametrize(
    ('message', 'hint'),
    [
        ('stop: scan too old', 'see `scan`'),
        ('stop: no room to stop in', 'make room by hand'),
        ('stop: setpoint_raw asks for 99.0 m/s', 'see the local planner'),
        ('stop: no plan', 'send a goal'),
        ('stop: setpoint too old', 'see the local planner'),
        ('stop: emergency stop', 'SetBool "{data: false}"'),
        ('stop: sea monster', 'docs/diagnostics.md'),
    ],
)
def test_a_stop_and_its_reason(message, hint):
    finding = only(saying(well(), 'dwa_planner', level=1, message=message))
    assert (finding.check, finding.status, finding.found) == ('dwa_planner', 'warn', f'active: {message}')
    assert hint in finding.mend


def test_to_have_arrived_is_no_fault():
    assert not wrong(saying(well(), 'dwa_planner', level=1, message='stop: goal reached'))


def test_an_error_of_a_node_is_a_failure():
    finding = only(saying(well(), 'bag_recorder', level=2, message='recording has stopped: disk full'))
    assert (finding.check, finding.status) == ('bag_recorder', 'fail')


@pytest.mark.parametrize(('state', 'transition'), [('unconfigured', 'configure'), ('inactive', 'activate')])
def test_a_node_that_is_not_active(state, transition):
    graph = saying(well(), 'pid_controller', message=state, state=state, odom_age_s='inf')
    finding = only(graph)
    assert (finding.check, finding.status) == ('pid_controller', 'warn')
    assert f'ros2 lifecycle set /pid_controller {transition}' in finding.mend


def test_a_silent_node():
    graph = well()
    statuses = {node: graph.statuses[node] for node in NODES if node != 'dwa_planner'}
    finding = only(graph._replace(statuses=statuses))
    assert (finding.check, finding.found) == ('dwa_planner', 'publishes no diagnostics')


def test_two_publishers_where_one_belongs():
    both = (end('setpoint', 'safety_monitor'), end('setpoint', 'joystick'))
    finding = only(joined(well(), 'setpoint', both))
    assert (finding.check, finding.found) == ('setpoint', '2 publishers: safety_monitor, joystick')


def test_two_graphs_on_a_domain():
    finding = only(well()._replace(nodes=(*NODES, 'sim')))
    assert (finding.check, finding.found) == ('two graphs', 'more than one sim')
    assert 'ROS_DOMAIN_ID' in finding.mend


def test_graphs_in_namespaces_of_their_own_are_told_apart():
    first = well()._replace(namespace='/a')
    second = joined(well()._replace(namespace='/b'), 'scan', publishers=())
    findings = judge([first, second], 'ROS domain 0')
    assert findings[0].found == 'ROS domain 0, namespace /a, /b'
    assert [finding.check for finding in findings if finding.status == 'fail'] == ['/b scan']


def test_the_mend_is_for_the_nodes_of_the_namespace():
    boat = well()._replace(namespace='/boat_1')
    stopped = only(saying(boat, 'safety_monitor', level=1, message='stop: emergency stop'))
    assert 'service call /boat_1/safety_monitor/emergency_stop' in stopped.mend
    asleep = only(saying(boat, 'pid_controller', state='inactive', message='inactive'))
    assert 'lifecycle set /boat_1/pid_controller activate' in asleep.mend
    weak = joined(boat, 'scan', (end('scan', 'driver', reliable=False),), (end('scan', 'dwa_planner'),))
    assert 'qos_overrides./boat_1/scan.subscription' in only(weak).mend


def test_nodes_that_run_are_seen(graph):
    graph.add(PidController)
    graph.build(make_dwa)
    publisher = graph.other.create_publisher(TOPICS['setpoint'].type, 'setpoint', qos_profile_sensor_data)
    with ThreadPoolExecutor(1) as pool:
        future = pool.submit(look, 4.0, graph.context.get_domain_id())
        graph.until(future.done)
    (seen,) = future.result()
    assert set(seen.nodes) == {'pid_controller', 'dwa_planner', 'other'}
    assert [end.node for end in seen.ends('setpoint').publishers] == ['other']
    found = {finding.check: finding for finding in wrong(seen)}
    stop = found.pop('pid_controller')
    assert (stop.status, stop.found.partition(' no ')[0]) == ('warn', 'active: stop:')
    assert stop.mend.startswith('see `odom`')
    assert {(check, finding.found) for check, finding in found.items()} == {
        ('odom', 'nobody publishes it; listening: pid_controller'),
        ('cmd_actuators', 'pid_controller publishes it and nobody obeys'),
        ('dwa_planner', 'unconfigured'),
        ('setpoint', 'pid_controller has heard nothing of it from other'),
    }
    graph.other.destroy_publisher(publisher)


def test_an_empty_domain_is_told_and_seconds_are_checked(monkeypatch, capsys):
    monkeypatch.setenv('ROS_DOMAIN_ID', '60')
    monkeypatch.setattr(graph_doctor, 'DISCOVERY_S', 0.5)
    assert cli.main(['doctor', '--graph', '0.5', '--json']) == 1
    (finding,) = json.loads(capsys.readouterr().out)
    assert finding['found'] == 'no node of portnav on ROS domain 60'
    assert cli.main(['doctor', '--graph', '0']) == 2
    assert 'listen for more than 0 s' in capsys.readouterr().err
