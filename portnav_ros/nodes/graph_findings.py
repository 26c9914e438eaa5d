"""What is wrong with a running graph, and how to mend it: from what a listener saw of it to findings."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from portnav_ros.findings import Finding
from portnav_ros.nodes.qos_match import End, Ends, Mismatch, mismatches
from portnav_ros.nodes.table import NAMES, RECORDER
from portnav_ros.nodes.topics import TOPICS

OK, WARN, ERROR = 0, 1, 2  # of DiagnosticStatus
DRIVER = 'the driver: `portnav run sim`, or the vessel, see docs/vessel.md'
SENDERS = {
    'odom': DRIVER,
    'scan': DRIVER,
    'plan': '`portnav run global_planner`, once it has a goal',
    'setpoint_raw': 'a local planner, such as `portnav run dwa_planner`',
    'setpoint': '`portnav run safety_monitor`',
    'cmd_actuators': '`portnav run pid_controller`',
}
OBEYING = {'setpoint_raw': SENDERS['setpoint'], 'setpoint': SENDERS['cmd_actuators'], 'cmd_actuators': DRIVER}
SINGLE = ('odom', 'scan', 'joint_states', 'clock', 'cmd_actuators', 'map', 'plan', 'setpoint_raw', 'setpoint')
AGES_S = {'odom': 0.5, 'scan': 0.5, 'setpoint_raw': 1.5, 'setpoint': 1.5, 'cmd_actuators': 1.0}
LEAST_SHARE = 0.5  # of a topic's rate: below it, the contract is broken
OVERRUNS_SHARE = 0.05
HUNG = '; where it runs, it hangs: end it first'  # what hangs is not discovered
MONITOR = '/safety_monitor'  # in the root namespace
ACTIVE, RUNNING, WAITING, PLANNED = 'active', 'RUNNING', 'waiting for', 'planned'
ADVICE = {  # by what a message holds, the first that fits
    'QoS': 'see the topic below',
    'refused': 'see the topic below',
    'trained for': 'take a model trained for this vessel, or another planner',
    'emergency': f'ros2 service call {MONITOR}/emergency_stop std_srvs/srv/SetBool "{{data: false}}"',
    'room': 'make room by hand; where nothing is near, see the zones in docs/safety.md',
    'GOAL_': 'send a goal on the chart, further from its quays',
    'START_': 'see `odom`: by the chart, the vessel lies on a quay, or too close to one',
    'no plan': 'send a goal on `goal_pose`, and see global_planner',
    'odom': f'see `odom`; it comes from {DRIVER}',
    'scan': f'see `scan`; it comes from {DRIVER}',
    'setpoint': 'see the local planner and safety_monitor',
    'cmd_actuators': 'see pid_controller',
    'no commands': 'see pid_controller',
    'disabled': 'enable the driver by its service ~/enable, once it is safe to',
}


class Status(NamedTuple):
    """The newest diagnostics of a node."""

    level: int
    message: str
    values: Mapping[str, str]

    def number(self, key: str) -> float:
        """A value as a number, NaN where there is none."""
        try:
            return float(self.values[key])
        except (KeyError, ValueError):
            return math.nan


class Graph(NamedTuple):
    """What was seen of the nodes of one namespace.

    nodes: their names, twice where two share one. topics: ends by the names of the table. statuses:
    diagnostics by node.
    """

    namespace: str
    nodes: tuple[str, ...]
    topics: Mapping[str, Ends]
    statuses: Mapping[str, Status]

    def resolve(self, name: str) -> str:
        """Full name of a node or topic."""
        return f'{self.namespace.rstrip("/")}/{name}'

    def ends(self, topic: str) -> Ends:
        """Ends of a topic, none where it is not there."""
        return self.topics.get(topic, Ends())

    @property
    def standstill(self) -> str:
        """Why nothing moves although nothing is wrong; empty where it does."""
        sim = self.statuses.get('sim')
        if sim is None:
            return ''
        if sim.message.startswith(WAITING):
            return sim.message
        outcome = sim.values.get('outcome', RUNNING)
        return '' if outcome == RUNNING else f'the episode has ended: {outcome}'

    @property
    def unplanned(self) -> bool:
        """Whether the global planner has nothing to publish, as there is no goal yet."""
        planner = self.statuses.get('global_planner')
        return planner is not None and planner.message != PLANNED


def judge(graphs: Sequence[Graph], place: str) -> list[Finding]:
    """Return findings on all graphs that were seen.

    Args:
        graphs: one for each namespace with nodes of the table.
        place: where they were looked for, such as ``ROS domain 0``.
    """
    if not graphs:
        mend = (
            'start one with `portnav up`; where one runs, give this command its ROS_DOMAIN_ID and '
            'ROS_AUTOMATIC_DISCOVERY_RANGE'
        )
        return [Finding('graph', 'fail', f'no node of portnav on {place}', mend)]
    several = len(graphs) > 1
    names = ', '.join(graph.namespace for graph in graphs)
    findings = [Finding('graph', 'ok', f'{place}, namespace {names}')]
    for graph in graphs:
        for finding in judge_graph(graph):
            check = f'{graph.namespace} {finding.check}' if several else finding.check
            findings.append(finding._replace(check=check))
    return findings


def judge_graph(graph: Graph) -> list[Finding]:
    """Return findings on one graph: what is there twice or not at all, then nodes, then topics."""
    return [
        *_doubles(graph),
        *_gaps(graph),
        *(finding for node in _in_order(graph) for finding in _node(graph, node)),
        *(finding for topic in TOPICS for finding in _unmatched(graph, topic)),
        *(finding for node in _in_order(graph) for finding in _inputs(graph, node)),
    ]


def _in_order(graph: Graph) -> list[str]:
    """The nodes of the table, and others that say how they are."""
    known = [name for name in NAMES if name in graph.nodes]
    return known + sorted(set(graph.statuses) - set(known))


def _doubles(graph: Graph) -> Iterator[Finding]:
    twice = [name for name, count in Counter(graph.nodes).items() if count > 1 and name in NAMES]
    if twice:
        mend = (
            'end one of the graphs, or start it with another ROS_DOMAIN_ID or --namespace; a node that was '
            'killed a moment ago is still listed for up to 20 s'
        )
        yield Finding('two graphs', 'fail', f'more than one {", ".join(sorted(twice))}', mend)
    for topic in SINGLE:
        publishers = [end.node for end in graph.ends(topic).publishers]
        if len(publishers) > 1:
            mend = f'end one of them: only one may publish {topic}'
            yield Finding(topic, 'fail', f'{len(publishers)} publishers: {", ".join(publishers)}', mend)


def _gaps(graph: Graph) -> Iterator[Finding]:
    for topic, sender in SENDERS.items():
        publishers, subscribers = graph.ends(topic)
        listening = [end.node for end in subscribers if end.node != RECORDER]
        if listening and not publishers:
            found = f'nobody publishes it; listening: {", ".join(sorted(set(listening)))}'
            yield Finding(topic, 'fail', found, f'start {sender}{HUNG}')
        if publishers and not listening and topic in OBEYING:
            found = f'{publishers[0].node} publishes it and nobody obeys'
            yield Finding(topic, 'fail', found, f'start {OBEYING[topic]}{HUNG}')


def _node(graph: Graph, node: str) -> Iterator[Finding]:
    status = graph.statuses.get(node)
    if status is None:
        mend = 'it hangs, or has just been started: read its log; end it if it stays silent'
        yield Finding(node, 'fail', 'publishes no diagnostics', mend)
        return
    state = status.values.get('state', ACTIVE)
    found = state if status.message == state else f'{state}: {status.message}'
    if state != ACTIVE:
        mend = (
            f'ros2 lifecycle set {graph.resolve(node)} {"activate" if state == "inactive" else "configure"}'
        )
        yield Finding(node, 'warn', found, f'{mend}; `portnav up` does so by itself')
    elif status.level == OK:
        yield Finding(node, 'ok', f'{found}{_model(status)}')
    elif 'goal reached' in status.message:
        yield Finding(node, 'ok', found)
    else:
        yield Finding(
            node, 'fail' if status.level >= ERROR else 'warn', found, _advice(graph, status.message)
        )
    yield from _slow(node, status)


def _model(status: Status) -> str:
    values = status.values
    return f', model {values["model"]} {values.get("model_sha256", "")[:12]}' if 'model' in values else ''


def _advice(graph: Graph, message: str) -> str:
    hints = (hint for word, hint in ADVICE.items() if word in message)
    hint = next(hints, 'see docs/diagnostics.md, and its log')
    return hint.replace(MONITOR, graph.resolve(MONITOR.strip('/')))


def _slow(node: str, status: Status) -> Iterator[Finding]:
    overruns, calls = status.number('overruns'), status.number('calls')
    if overruns > OVERRUNS_SHARE * calls:
        found = (
            f'{overruns:.0f} of its last {calls:.0f} calls took longer than until the next was due; '
            f'{status.values.get("loop")}: p50 {status.number("loop_p50_ms"):.1f} ms, '
            f'p95 {status.number("loop_p95_ms"):.1f} ms, max {status.number("loop_max_ms"):.1f} ms'
        )
        mend = 'leave it a processor core: less beside it, fewer simulations, one numerical thread a node'
        yield Finding(f'{node} is slow', 'warn', found, mend)


def _unmatched(graph: Graph, topic: str) -> Iterator[Finding]:
    for pair in _pairs(graph, topic):
        yield Finding(topic, 'fail', str(pair), pair.mend)


def _pairs(graph: Graph, topic: str) -> list[Mismatch]:
    """Ends that do not match, or else a publisher that would not match what the table asks."""
    ends, row, name = graph.ends(topic), TOPICS[topic], graph.resolve(topic)
    package, kind = row.type.__module__.partition('.')[0], row.type.__name__
    asked = End('the stack', reliable=row.latched, latched=row.latched, type=f'{package}/msg/{kind}')
    return list(mismatches(name, ends)) or list(mismatches(name, ends._replace(subscribers=(asked,))))


def _inputs(graph: Graph, node: str) -> Iterator[Finding]:
    """What a node itself tells of its inputs; nothing on time while nothing moves."""
    status = graph.statuses.get(node)
    if status is None:
        return
    for topic in TOPICS:
        if reason := status.values.get(f'refused_{topic}_reason'):
            senders = ', '.join(end.node for end in graph.ends(topic).publishers) or 'its publisher'
            count = status.values.get(f'refused_{topic}')
            found = f'{node} has refused {count} since activation, the last because: {reason}'
            yield Finding(topic, 'warn', found, f'mend {senders}')
        deaf = any(node == pair.subscriber for pair in _pairs(graph, topic))
        if status.values.get('state', ACTIVE) == ACTIVE and not (graph.standstill or deaf):
            yield from _flow(graph, topic, node, status)


def _flow(graph: Graph, topic: str, node: str, status: Status) -> Iterator[Finding]:
    age_s, behind_s = status.number(f'{topic}_age_s'), status.number(f'{topic}_behind_s')
    rate_hz, limit_s = TOPICS[topic].rate_hz * _pace(graph), AGES_S.get(topic, math.inf) / _pace(graph)
    publishers = ', '.join(end.node for end in graph.ends(topic).publishers)
    if not publishers or (topic == 'plan' and graph.unplanned):
        return
    if age_s == math.inf and topic in SENDERS:
        mend = f'see {publishers}; where it is well: the network, or ROS_AUTOMATIC_DISCOVERY_RANGE'
        yield Finding(topic, 'fail', f'{node} has heard nothing of it from {publishers}', mend)
    elif limit_s < age_s < math.inf:
        found = f'{node} has heard none for {age_s:.1f} s, and may wait {limit_s:.1f} s'
        yield Finding(topic, 'fail', found, f'see {publishers}')
    elif status.number(f'{topic}_hz') < LEAST_SHARE * rate_hz:
        found = f'{node} hears {status.number(f"{topic}_hz"):.1f} Hz of at least {LEAST_SHARE * rate_hz:g} Hz'
        yield Finding(topic, 'warn', found, f'see {publishers}: it is slow, or messages are lost')
    if behind_s > AGES_S.get(topic, math.inf):
        found = f'at {node} its stamps are {behind_s:.1f} s behind those of other topics'
        yield Finding(topic, 'fail', found, f'let {publishers} stamp by the same clock as the rest')


def _pace(graph: Graph) -> float:
    """Simulated seconds in a second, at most 1: a slow sim's topics come as much more seldom."""
    sim = graph.statuses.get('sim')
    rate = math.nan if sim is None else sim.number('achieved_rate')
    return min(rate, 1.0) if rate > 0.0 else 1.0
