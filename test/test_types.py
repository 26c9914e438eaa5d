import pytest

from portnav_ros.types import STATE_SIZE, Outcome, VesselState


def test_state_row_holds_every_field():
    assert len(VesselState(0.0, 0.0, 0.0)) == STATE_SIZE
    assert VesselState._fields.index('thrust_n') == STATE_SIZE - 1


@pytest.mark.parametrize('outcome', Outcome)
def test_collisions_are_the_three_that_say_so(outcome):
    assert outcome.collision == outcome.name.startswith('COLLISION')


def test_only_running_is_false():
    assert [outcome for outcome in Outcome if not outcome] == [Outcome.RUNNING]
