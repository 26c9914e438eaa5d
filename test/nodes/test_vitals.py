"""What a node tells of its inputs and callbacks, with time as an argument."""

import math

from portnav_ros.nodes.vitals import CALLS, Vitals

SECOND_NS = 1_000_000_000


def hear(vitals, topic, times_s, offset_s=0.0):
    """Messages stamped as they come, less an offset."""
    for time_s in times_s:
        vitals.hear(topic, time_s, round((time_s - offset_s) * SECOND_NS))


def test_an_input_that_says_nothing_has_no_end_of_age():
    vitals = Vitals()
    vitals.expect('scan')
    assert vitals.report(5.0) == {'scan_age_s': 'inf'}
    assert float(vitals.report(6.0)['scan_age_s']) == math.inf
    assert vitals.report(7.0)['scan_hz'] == '0.0'


def test_age_and_rate():
    vitals = Vitals()
    vitals.expect('odom')
    vitals.report(0.0)
    for second in range(1, 11):
        rate = 20 if second <= 5 else 10  # the sender slows down
        hear(vitals, 'odom', [second - 1 + k / rate for k in range(rate)])
        told = vitals.report(second)
    assert (told['odom_hz'], told['odom_age_s']) == ('10.0', '0.100')
    for second in range(11, 16):
        told = vitals.report(second)
    assert (told['odom_hz'], told['odom_age_s']) == ('0.0', '5.100')


def test_stamps_are_told_against_the_newest():
    vitals = Vitals()
    for topic in ('odom', 'scan', 'plan'):
        vitals.expect(topic)
    hear(vitals, 'scan', [1.0], offset_s=0.3)
    vitals.hear('plan', 1.0)
    hear(vitals, 'odom', [1.1])
    told = vitals.report(1.2)
    assert (told['odom_behind_s'], told['scan_behind_s']) == ('0.000', '0.400')
    assert 'plan_behind_s' not in told


def test_a_clock_that_is_set_back_is_told_from_then_on():
    vitals = Vitals()
    vitals.expect('odom')
    vitals.hear('odom', 1.0, 100 * SECOND_NS)
    vitals.hear('odom', 2.0, 0)
    assert vitals.report(2.0)['odom_behind_s'] == '0.000'


def test_refusals_are_counted_with_the_last_reason():
    vitals = Vitals()
    vitals.expect('scan')
    vitals.expect('odom')
    vitals.refuse('scan', 'ranges is empty', 1.0)
    vitals.refuse('scan', 'ranges holds only NaN', 2.0)
    told = vitals.report(1.0)
    assert (told['refused_scan'], told['refused_scan_reason']) == ('2', 'ranges holds only NaN')
    assert 'refused_odom' not in told
    assert vitals.reasons == vitals.refusing(3.0) == {'scan': 'ranges holds only NaN'}
    assert not vitals.refusing(60.0), 'worth no warning any more'
    assert (vitals.refused['scan'], vitals.refused['odom']) == (2, 0)


def test_durations_are_those_of_the_callback_that_takes_most_time():
    vitals = Vitals()
    vitals.watch('odom', 0.05)
    vitals.watch('scan', 0.1)
    vitals.watch('never', 1.0)
    for _ in range(100):
        vitals.spend('odom', 0.0001)
    for k in range(1, 21):
        vitals.spend('scan', 0.01 * k)
    told = vitals.report(1.0)
    assert told['loop'] == 'scan'
    assert [told[f'loop_{name}_ms'] for name in ('p50', 'p95', 'max')] == ['100.000', '190.000', '200.000']
    assert (told['overruns'], told['calls']) == ('10', '120')


def test_only_the_last_calls_count():
    vitals = Vitals()
    vitals.watch('odom', 0.05)
    vitals.spend('odom', 9.0)
    for _ in range(CALLS):
        vitals.spend('odom', 0.001)
    told = vitals.report(1.0)
    assert (told['loop_max_ms'], told['overruns'], told['calls']) == ('1.000', '0', str(CALLS))


def test_without_a_period_nothing_overruns():
    vitals = Vitals()
    vitals.watch('odom')
    vitals.spend('odom', 100.0)
    assert vitals.report(1.0)['overruns'] == '0'


def test_to_begin_is_to_forget_all_but_what_is_expected():
    vitals = Vitals()
    vitals.expect('odom')
    vitals.expect('plan', lasting=True)
    vitals.watch('odom', 0.05)
    hear(vitals, 'odom', [1.0])
    vitals.hear('plan', 1.0)
    vitals.refuse('odom', 'frame', 1.0)
    vitals.spend('odom', 1.0)
    vitals.begin()
    assert vitals.report(2.0) == {'odom_age_s': 'inf', 'plan_age_s': '1.000'}
    assert not vitals.reasons
    vitals.spend('odom', 1.0)
    assert vitals.report(3.0)['overruns'] == '1'


def test_topics_do_not_share_what_they_heard():
    vitals = Vitals()
    vitals.expect('odom')
    vitals.expect('scan')
    hear(vitals, 'odom', [1.0])
    assert vitals.report(1.0)['scan_age_s'] == 'inf'
