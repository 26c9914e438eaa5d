import numpy as np
import pytest

from portnav_ros.evaluation.episode_log import TargetTrack
from portnav_ros.evaluation.hull_clearance import hull_corners, poses_at, with_clearance


def test_gaps_of_a_straight_passage_by_hand(straight):
    log = with_clearance(straight(clearance=None))
    half_length, half_beam = 0.5 * log.vessel.length_m, 0.5 * log.vessel.beam_m
    at_buoy = int(np.argmin(np.abs(log.own[:, 0] - 250.0)))
    assert log.clearance[at_buoy, 1] == pytest.approx(60.0 - 3.0 - half_beam)
    at_pier = int(np.argmin(np.abs(log.own[:, 0] - 140.0)))
    assert log.clearance[at_pier, 0] == pytest.approx(120.0 - half_beam)
    assert log.clearance[0, 0] == pytest.approx(50.0 - half_length)
    target = log.targets[0]
    abeam = int(np.argmin(np.abs(600.0 - 4.0 * log.time_s - log.own[:, 0])))
    assert log.clearance[abeam, 2] == pytest.approx(90.0 - half_beam - 0.5 * target.beam_m)


def test_a_hull_ashore_has_no_clearance(straight):
    log = straight(clearance=None)
    log.own[5, :2] = (140.0, -160.0)
    assert with_clearance(log).clearance[5, 0] == 0.0


def test_recorded_clearances_are_kept(straight):
    log = straight()
    assert with_clearance(log) is log


def test_corners_turn_with_the_hull():
    (corners,) = hull_corners(np.array([[1.0, 2.0, np.pi / 2]]), 10.0, 4.0)
    np.testing.assert_allclose(corners, [[-1.0, 7.0], [-1.0, -3.0], [3.0, -3.0], [3.0, 7.0]], atol=1e-12)


def test_a_target_is_there_only_while_recorded():
    pose = np.array([[0.0, 0.0, 3.1, 1.0], [10.0, 0.0, -3.1, 1.0]])
    poses = poses_at(TargetTrack('1', np.array([10.0, 20.0]), pose, 5.0, 2.0), np.array([0.0, 15.0, 30.0]))
    assert np.isnan(poses[[0, 2]]).all()
    assert poses[1, 0] == pytest.approx(5.0)
    assert abs(poses[1, 2]) == pytest.approx(np.pi, abs=0.01)


def test_a_target_that_was_lost_did_not_sail_straight_on():
    pose = np.array([[-300.0, 0.0, 0.0, 0.0], [300.0, 0.0, 0.0, 0.0]])
    track = TargetTrack('1', np.array([0.0, 18.0]), pose, 5.0, 2.0)
    poses = poses_at(track, np.array([0.0, 1.0, 3.0, 9.0, 15.0, 17.0, 18.0]))
    np.testing.assert_array_equal(np.isnan(poses[:, 0]), [False, False, True, True, True, False, False])


def test_a_single_pose_is_enough():
    track = TargetTrack('1', np.array([5.0]), np.array([[1.0, 2.0, 0.0, 0.0]]), 5.0, 2.0)
    poses = poses_at(track, np.array([2.0, 4.0, 5.0, 8.0]))
    np.testing.assert_array_equal(np.isnan(poses[:, 0]), [True, False, False, True])
