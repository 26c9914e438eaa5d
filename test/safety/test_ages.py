"""Ages by stamp and receipt, in the time that the driver's stamps tell."""

import math

import pytest

from portnav_ros.safety.ages import Arrival, InputAges

SECOND_NS = 1_000_000_000
BEGIN_S = 1000.0  # of the steady clock, which knows nothing of the stamps


def ns(time_s):
    return round(time_s * SECOND_NS)


class Driver:
    """Sends odometry and scans; time_s is both the driver's time and, with BEGIN_S, the steady clock's."""

    def __init__(self, rate=1.0):
        self.ages = InputAges({'odom': 0.5, 'scan': 0.5}, rate)

    def send(self, name, stamp_s, time_s=None):
        return self.ages.note(name, ns(stamp_s), BEGIN_S + (stamp_s if time_s is None else time_s))

    def reason(self, time_s):
        return self.ages.too_old(BEGIN_S + time_s)


@pytest.fixture
def driver():
    driver = Driver()
    for tick in range(3):
        driver.send('odom', 0.1 * tick)
        driver.send('scan', 0.1 * tick)
    return driver


def test_what_was_never_heard_is_missing():
    driver = Driver()
    assert driver.reason(0.0) == 'no odom yet'
    driver.send('odom', 0.0)
    assert driver.reason(0.0) == 'no scan yet'
    assert driver.ages.age_s('scan', BEGIN_S) == math.inf


def test_silence_of_all_inputs_is_noticed(driver):
    assert driver.reason(0.69) == ''
    assert driver.reason(0.71) == 'odom too old'


def test_silence_of_one_is_told_by_the_stamps_of_the_other(driver):
    driver.send('odom', 0.75)
    assert driver.reason(0.75) == 'scan too old'


def test_a_message_that_comes_late_is_as_old_as_its_stamp(driver):
    driver.send('odom', 0.6)
    driver.send('scan', 0.3, time_s=0.6)
    assert driver.ages.age_s('scan', BEGIN_S + 0.6) == pytest.approx(0.3)


def test_a_stamp_that_stands_still_is_no_receipt(driver):
    for tick in range(3, 9):
        assert driver.send('odom', 0.2, time_s=0.1 * tick) is Arrival.REPEATED
        driver.send('scan', 0.1 * tick)
    assert driver.reason(0.8) == 'odom too old'


def test_before_time_begins_the_first_stamp_may_be_repeated():
    driver = Driver()
    for repetition in range(10):
        driver.send('odom', 0.0, time_s=0.2 * repetition)
        driver.send('scan', 0.0, time_s=0.2 * repetition)
    assert driver.reason(1.9) == ''
    assert driver.reason(2.4) == 'odom too old'


def test_a_stamp_in_the_future_is_refused_and_leaves_the_age_alone(driver):
    assert driver.send('scan', 0.45, time_s=0.3) is Arrival.FUTURE
    assert driver.send('scan', 0.39, time_s=0.3) is Arrival.TAKEN
    assert driver.ages.age_s('scan', BEGIN_S + 0.6) == pytest.approx(0.3)


def test_a_clock_that_jumps_back_voids_everything(driver):
    assert driver.send('odom', 0.05, time_s=0.25) is Arrival.JUMPED
    assert driver.reason(0.25) == 'no scan since the clock jumped'
    assert driver.send('scan', 0.05, time_s=0.26) is Arrival.TAKEN
    assert driver.reason(0.26) == ''


def test_one_message_that_was_overtaken_is_no_jump(driver):
    driver.send('odom', 0.25)
    assert driver.send('odom', 0.2, time_s=0.26) is Arrival.REPEATED


def test_a_jump_ahead_is_believed_once_messages_agree(driver):
    arrivals = [driver.send('odom', 3600.0 + 0.05 * k, time_s=0.25 + 0.05 * k) for k in range(3)]
    assert arrivals == [Arrival.FUTURE, Arrival.FUTURE, Arrival.JUMPED]
    assert driver.reason(0.35) == 'no scan since the clock jumped'


def test_stray_stamps_from_the_future_never_add_up_to_a_jump(driver):
    for k in range(20):
        time_s = 0.25 + 0.05 * k
        assert driver.send('odom', 1000.0 * (k + 1), time_s=time_s) is Arrival.FUTURE
        assert driver.send('odom', time_s) is Arrival.TAKEN


def test_a_pause_of_the_driver_is_no_jump(driver):
    assert driver.send('odom', 0.25, time_s=60.0) is Arrival.TAKEN
    assert driver.send('odom', 60.3, time_s=120.0) is Arrival.TAKEN


def test_in_slow_motion_silence_is_counted_in_the_drivers_time():
    driver = Driver(rate=0.1)
    for name in ('odom', 'scan'):
        driver.send(name, 0.0, time_s=0.0)
        driver.send(name, 0.05, time_s=0.5)
    assert driver.reason(5.0) == ''
    assert driver.reason(5.6) == 'odom too old'


def test_faster_than_the_clock_a_stamp_may_lag_as_the_clock_allows():
    driver = Driver(rate=10.0)
    driver.send('odom', 0.0)
    driver.send('scan', 0.0)
    driver.send('odom', 4.9, time_s=0.49)
    assert driver.reason(0.49) == ''
    driver.send('odom', 5.1, time_s=0.51)
    assert driver.reason(0.51) == 'scan too old'


def test_faster_than_the_clock_silence_is_counted_by_the_clock():
    driver = Driver(rate=20.0)
    for name in ('odom', 'scan'):
        driver.send(name, 0.0, time_s=0.0)
        driver.send(name, 1.0, time_s=0.05)
    assert driver.reason(0.5) == ''
    assert driver.reason(0.6) == 'odom too old'


def test_what_came_first_from_another_clock_does_not_make_all_else_old():
    driver = Driver()
    driver.send('scan', 5000.0, time_s=0.0)
    for tick in range(5):
        driver.send('odom', 0.1 * tick)
        assert driver.send('scan', 5000.0 + 0.1 * tick, time_s=0.1 * tick) is Arrival.FUTURE
    assert driver.reason(0.4) == 'no scan yet'
    driver.send('scan', 0.4)
    assert driver.reason(0.4) == ''


def test_a_scan_that_came_before_the_first_odometry_counts():
    driver = Driver()
    driver.send('scan', 0.05, time_s=0.0)
    driver.send('odom', 0.0)
    assert driver.reason(0.0) == ''
