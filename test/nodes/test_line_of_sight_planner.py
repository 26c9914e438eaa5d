"""The follower's own parameter reaches the setpoint; the rest is every local planner's."""

import pytest

from portnav_ros.nodes.line_of_sight_planner import LineOfSightParams, make_node, make_policy
from portnav_ros.params import ParamError


def test_the_first_metres_can_be_sailed_slowly(graph):
    node = graph.build(make_node, speed_mps=0.8)
    assert make_policy(node.params).speed_mps == 0.8
    assert make_policy(LineOfSightParams()).speed_mps == 5.0


def test_a_speed_that_never_arrives_is_refused():
    with pytest.raises(ParamError, match='speed_mps'):
        LineOfSightParams(speed_mps=0.0)
