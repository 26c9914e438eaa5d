"""Every fault of the table, one after the other on one graph: the vessel stops, and sails again."""

import pytest

from portnav_ros.evaluation.bags import read_bag
from portnav_ros.nodes.faults.rig import Rig
from portnav_ros.nodes.faults.table import FAULTS


@pytest.fixture(scope='module')
def rig(tmp_path_factory):
    folder = tmp_path_factory.mktemp('faults')
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('XDG_RUNTIME_DIR', str(folder / 'runtime'))
        patch.setenv('ROS_DOMAIN_ID', '61')
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        with Rig(folder / 'graph') as rig:
            yield rig


@pytest.mark.parametrize('fault', FAULTS, ids=lambda fault: fault.name)
def test_a_fault_is_survived(rig, fault):
    row = rig.run(fault)
    assert row.passed, row


def test_the_bag_holds_what_came_before_the_recorder_died(rig):
    bag = read_bag(rig.graph.out / 'run')
    assert bag.lost, 'it says that its end is missing'
    assert len(bag.messages['/odom']) > 100
