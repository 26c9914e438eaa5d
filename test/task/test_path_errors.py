"""Line-of-sight errors on legs with a known answer."""

import math

import numpy as np
import pytest

from portnav_ros.task.path_errors import advance, path_errors, path_errors_along, path_point, remaining_m

LEG = np.column_stack([np.arange(0.0, 1001.0, 10.0), np.zeros(101)])


def own(x, y, yaw=0.0):
    return np.array([x, y, yaw, 0.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize('offset', [-40.0, 0.0, 25.0])
def test_errors_on_a_straight_leg(offset):
    state = own(300.0, offset)
    progress = advance(LEG, len(LEG), -1.0, 300.0, offset)
    e_x, e_y, e_psi = path_errors(state, LEG, len(LEG), progress, 100.0)
    assert (e_x, e_y) == pytest.approx((0.0, offset))
    assert e_psi == pytest.approx(math.atan(offset / 100.0))


def test_position_errors_are_in_the_body_frame():
    e_x, e_y, _ = path_errors(own(300.0, 20.0, math.pi / 2), LEG, len(LEG), 30.0, 100.0)
    assert (e_x, e_y) == pytest.approx((20.0, 0.0))


def test_progress_has_a_fraction_and_ends_at_the_last_point():
    assert advance(LEG, len(LEG), 0.0, 37.0, 5.0) == pytest.approx(3.7)
    assert advance(LEG, len(LEG), 99.0, 5000.0, 0.0) == pytest.approx(100.0)
    assert path_point(LEG, len(LEG), 250.0) == pytest.approx((1000.0, 0.0))
    assert remaining_m(LEG, 99.0) == pytest.approx(10.0)


def test_progress_does_not_jump_to_a_later_leg_that_comes_close():
    back = np.vstack([LEG, np.column_stack([LEG[::-1, 0], np.full(101, 30.0)])])
    progress = advance(back, len(back), 20.0, 205.0, 29.0)
    assert progress == pytest.approx(20.5)
    assert advance(back, len(back), -1.0, 205.0, 29.0) > 150.0


def test_errors_along_a_track():
    track = np.array([own(x, 10.0) for x in range(0, 900, 30)])
    errors = path_errors_along(track, LEG, 100.0)
    np.testing.assert_allclose(errors[:, 1], 10.0)
    np.testing.assert_allclose(errors[:, 2], math.atan(0.1))


def test_a_path_of_one_point_gives_finite_errors():
    assert np.isfinite(path_errors(own(3.0, 4.0), LEG[:1], 1, 0.0, 100.0)).all()
