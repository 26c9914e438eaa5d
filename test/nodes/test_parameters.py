"""Parameters of a node: described, bounded, and refused by name, from the command line and from files."""

import dataclasses
from dataclasses import dataclass, field
from typing import ClassVar, Literal

import pytest
from rcl_interfaces.msg import ParameterType
from rclpy.parameter import Parameter

from portnav_ros.declarations import declarations, descriptions
from portnav_ros.nodes.parameters import NodeParams, defaults_of
from portnav_ros.nodes.runtime import PortNode
from portnav_ros.nodes.table import NAMES
from portnav_ros.params import ParamError, Ranges, check_ranges


@dataclass(frozen=True)
class Gains:
    """Of a loop. kp: rad for each rad."""

    kp: float = 1.0
    ranges: ClassVar[Ranges] = {'kp': (0.0, 10.0)}

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class ProbeParams(NodeParams):
    """Parameters of a test. age_s: of what comes. count: of things. layout: of things. gains.*: of a loop."""

    age_s: float = 1.5
    count: int = 3
    layout: Literal['row', 'heap'] = 'row'
    gains: Gains = field(default_factory=Gains)
    ranges: ClassVar[Ranges] = {'age_s': (0.5, 60.0), 'count': (1, 10)}

    def __post_init__(self) -> None:
        check_ranges(self)


@pytest.fixture
def start(graph, tmp_path):
    def start_with(file='', *words):
        """The node `/tug/probe` with a parameter file and further arguments."""
        path = tmp_path / 'params.yaml'
        path.write_text(file or '/**: {ros__parameters: {use_sim_time: false}}', encoding='utf-8')
        arguments = ['--ros-args', '--params-file', str(path), '-r', '__ns:=/tug', *words]
        return graph.add(
            lambda context, parameter_overrides: PortNode(
                'probe', ProbeParams(), context=context, cli_args=arguments
            )
        )

    return start_with


@pytest.mark.parametrize('name', NAMES)
def test_every_parameter_of_every_node_is_described(name):
    defaults = defaults_of(name)
    groups = {
        f.name for f in dataclasses.fields(defaults) if dataclasses.is_dataclass(getattr(defaults, f.name))
    }
    silent = {one.name for one in declarations(defaults) if not one.description}
    assert silent | groups - set(descriptions(type(defaults))) == set(), (
        'say it in the docstring of the class'
    )


@pytest.mark.parametrize('name', NAMES)
def test_every_number_of_every_node_has_a_range(name):
    free = {
        one.name
        for one in declarations(defaults_of(name))
        if type(one.value) in (int, float) and one.interval is None
    }
    assert free == set(), 'declare it in `ranges` of the class'


def test_a_descriptor_tells_what_the_dataclass_declares(start):
    node = start()
    age, count, layout = node.describe_parameters(['age_s', 'count', 'layout'])
    assert (age.type, age.description, age.read_only) == (
        ParameterType.PARAMETER_DOUBLE,
        'of what comes [s]',
        True,
    )
    (bounds,) = age.floating_point_range
    assert (bounds.from_value, bounds.to_value, bounds.step) == (0.5, 60.0, 0.0)
    (bounds,) = count.integer_range
    assert (bounds.from_value, bounds.to_value, bounds.step) == (1, 10, 0)
    assert layout.additional_constraints.startswith('one of row, heap; ')
    assert node.describe_parameter('autostart').description
    assert not node.set_parameters([Parameter('age_s', value=2.0)])[0].successful


def test_a_file_reaches_the_node_by_name_wildcard_and_dots(start):
    node = start(
        '/**: {ros__parameters: {age_s: 2.0}}\n'
        '/tug/probe: {ros__parameters: {gains.kp: 3}}\n'
        '/**/probe: {ros__parameters: {count: 5}}\n'
        '/other/probe: {ros__parameters: {unknown: 1}}\n'
        'another: {ros__parameters: {unknown: 1}}\n',
        '-p',
        'layout:=heap',
    )
    assert node.params == ProbeParams(age_s=2.0, count=5, layout='heap', gains=Gains(3.0))


@pytest.mark.parametrize(
    ('file', 'reason'),
    [
        ('/**: {ros__parameters: {agee_s: 2.0}}', "unknown key 'agee_s'; did you mean 'age_s'"),
        ('/**/probe: {ros__parameters: {gains: {pk: 2.0}}}', "gains: unknown key 'pk'; known keys: kp"),
        ('/tug/probe: {ros__parameters: {gains.pk: 2.0}}', "gains: unknown key 'pk'; known keys: kp"),
        ('/tug/probe: {ros__parameters: {age_s.kp: 2.0}}', 'age_s: expected float'),
        ('/tug/probe: {ros__parameters: {gains: 1.0}}', 'gains: expected Gains'),
        ('/tug/probe: {ros__parameters: {gains: 1.0, gains.kp: 1.0}}', 'gains has a value already'),
        ('/*/probe: {ros__parameters: {age_s: 0.4}}', r'age_s = 0.4 is outside \[0.5, 60.0\]'),
        ('/**: {ros__parameters: {count: 11}}', 'count = 11 is outside'),
        ('/**: {ros__parameters: {layout: maze}}', "layout: 'maze' is not one of row, heap"),
        ('/**: {ros__parameters: {preset: raft}}', "unknown key 'preset'"),
        ('/**: {ros__parameters: {autostart: 1}}', 'autostart: expected bool'),
    ],
)
def test_a_wrong_file_is_refused_by_key(start, file, reason):
    with pytest.raises(ParamError, match=f'^probe: parameters: .*{reason}'):
        start(file)


def test_all_mistakes_are_told_at_once(start):
    with pytest.raises(ParamError) as refused:
        start('/**: {ros__parameters: {agee_s: 1.0, count: 0, gains: {kp: 11.0}}}')
    assert len(str(refused.value).splitlines()) == 3
