"""When a vessel counts as stopped, told by made-up commands."""

import pytest

from portnav_ros.nodes.faults.verdict import (
    Asked,
    Commanded,
    DriverClock,
    Row,
    is_safe,
    stopped_for_s,
    unsafe_for_s,
)


def test_only_thrust_ahead_is_unsafe_unless_it_holds_a_stopped_vessel():
    assert is_safe(0.0, stop_asked=False, surge_mps=3.0)
    assert is_safe(-500.0, stop_asked=False, surge_mps=3.0)
    assert not is_safe(1.0, stop_asked=False, surge_mps=0.0)
    assert not is_safe(1.0, stop_asked=True, surge_mps=3.0)
    assert is_safe(1.0, stop_asked=True, surge_mps=-0.2)


def test_an_unsafe_command_lasts_until_the_next_one():
    commands = [Commanded(9.9, False), Commanded(10.3, False), Commanded(10.4, True), Commanded(10.5, True)]
    assert unsafe_for_s(commands, 10.0, 12.0) == pytest.approx(0.4)


def test_an_unsafe_command_later_on_counts():
    commands = [Commanded(9.9, True), Commanded(11.0, False), Commanded(11.1, True)]
    assert unsafe_for_s(commands, 10.0, 12.0) == pytest.approx(1.1)


def test_without_commands_the_driver_goes_neutral_by_itself():
    assert unsafe_for_s([Commanded(9.9, False)], 10.0, 15.0) == pytest.approx(0.9)


def test_what_is_never_stopped_lasts_to_the_end():
    commands = [Commanded(time / 10.0, False) for time in range(100, 150)]
    assert unsafe_for_s(commands, 10.0, 14.0) == pytest.approx(4.0)


def test_what_ends_after_the_watch_does_not_count():
    assert unsafe_for_s([Commanded(9.9, True), Commanded(12.5, False)], 10.0, 12.0) == 0.0


def test_a_stop_lasts_until_the_next_setpoint():
    setpoints = [Asked(9.0, 5.0), Asked(10.5, 0.0), Asked(10.6, 0.0), Asked(12.5, 4.0), Asked(13.5, 0.0)]
    assert stopped_for_s(setpoints, 10.0, 14.0) == pytest.approx(2.5)
    assert stopped_for_s(setpoints, 12.0, 13.0) == pytest.approx(0.5)
    assert stopped_for_s([], 10.0, 14.0) == 0.0


def test_the_time_of_the_driver_goes_on_between_its_stamps():
    clock = DriverClock()
    assert clock.now_s(50.0) == 0.0
    clock.note(7.0, 50.0)
    assert clock.now_s(50.25) == pytest.approx(7.25)


def test_the_time_of_the_driver_goes_on_over_a_restart():
    clock = DriverClock()
    clock.note(7.0, 50.0)
    clock.note(0.0, 53.0)
    assert clock.now_s(53.0) == pytest.approx(10.0)
    clock.note(1.0, 54.0)
    assert clock.now_s(54.0) == pytest.approx(11.0)


def test_a_row_without_complaint_has_passed():
    row = Row('scan_lost', 1.5, 0.4, True, True, 'scan too old')
    assert row.passed
    assert not row._replace(complaint='it did not sail again').passed
