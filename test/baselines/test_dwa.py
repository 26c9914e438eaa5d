import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from portnav_ros.baselines.dwa import DwaParams, DynamicWindow, load_dwa_params
from portnav_ros.control.autopilot import AutopilotParams
from portnav_ros.params import ParamError
from portnav_ros.task.policy import Observation
from portnav_ros.types import SURGE, YAW, Outcome
from portnav_ros.vessel import VesselParams

RAYS = 180
SHUTTLE = VesselParams()


def window(**params):
    return DynamicWindow(SHUTTLE, AutopilotParams(), DwaParams(**params))


def observe(ranges, own=None, path=None):
    ranges = np.atleast_2d(np.asarray(ranges, np.float32))
    batch = len(ranges)
    own = [[0.0, 0.0, 0.0, 5.0, 0.0, 0.0, SHUTTLE.thrust_max_n]] * batch if own is None else own
    straight = np.column_stack([np.arange(0.0, 1001.0, 10.0), np.zeros(101)])
    path = np.repeat(straight[None], batch, axis=0) if path is None else path
    counts, progress = np.full(batch, path.shape[1]), np.zeros(batch)
    return Observation(
        ranges, np.asarray(own, float), path, counts, progress, np.zeros((batch, 1), np.float32)
    )


def clear():
    return np.full(RAYS, np.inf)


def random_scene(seed):
    rng = np.random.default_rng(seed)
    ranges = np.where(rng.random(RAYS) < 0.3, rng.uniform(15.0, 250.0, RAYS), np.inf)
    own = rng.normal([0, 0, 0, 4, 0, 0, 3e4], [20.0, 20.0, 1.0, 0.5, 0.02, 0.1, 9e3])
    path = np.cumsum(rng.normal([8.0, 0.0], [1.0, 4.0], (80, 2)), axis=0)
    return ranges, own[None], path[None]


def test_open_water_straight_ahead_at_full_speed():
    assert window().act(observe(clear())) == pytest.approx(np.array([[0.0, 5.0]]))


def test_turns_towards_the_path():
    own = [[0.0, 150.0, 0.0, 5.0, 0.0, 0.0, SHUTTLE.thrust_max_n]]
    assert window().act(observe(clear(), own))[0, 0] < 0.0


def test_slowest_before_a_dead_end():
    angles = -math.pi + 2.0 * math.pi / RAYS * np.arange(RAYS)
    with np.errstate(divide='ignore'):
        sides = 14.0 / np.abs(np.sin(angles))
        front = np.where(np.cos(angles) > 0.0, 30.0 / np.cos(angles), np.inf)

    assert window().act(observe(np.minimum(sides, front)))[0, 1] == 1.0


def test_rounds_a_buoy_that_the_blind_hit(canal, sail):
    world, _ = sail(window(), [canal(buoys=[(500.0, 0.0, 2.0)]), canal(buoys=[(400.0, 4.0, 3.0)])])

    assert world.outcome.tolist() == [Outcome.SUCCESS, Outcome.SUCCESS]


@pytest.mark.parametrize('vessel', ['workboat', 'cemt_i', 'cemt_va'])
def test_every_hull_rounds_a_buoy(vessel, canal, sail):
    from portnav_ros.sim.difficulty import load_vessel

    hull = load_vessel(vessel)
    world, _ = sail(DynamicWindow(hull, AutopilotParams()), [canal(buoys=[(550.0, 0.0, 2.0)], vessel=hull)])

    assert world.outcome[0] == Outcome.SUCCESS


@given(st.integers(0, 10_000))
def test_port_and_starboard_mirror(seed):
    ranges, own, path = random_scene(seed)
    mirrored = ranges[(-np.arange(RAYS)) % RAYS]
    signs = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0, 1.0])

    yaw, speed = window().act(observe(ranges, own, path))[0]
    other_yaw, other_speed = window().act(observe(mirrored, own * signs, path * [1.0, -1.0]))[0]

    assert math.cos(yaw + other_yaw) == pytest.approx(1.0)
    assert speed == other_speed


def test_rows_do_not_depend_on_each_other():
    scenes = [random_scene(seed) for seed in range(3)]
    together = observe(*map(np.concatenate, zip(*[([s[0]], *s[1:]) for s in scenes], strict=True)))

    apart = [window().act(observe(*scene))[0] for scene in scenes]

    assert np.array_equal(window().act(together), apart)


def test_invalid_rays_are_no_obstacles():
    ranges, own, path = random_scene(5)
    broken = np.where(np.isinf(ranges), np.nan, ranges)

    expected = window().act(observe(ranges, own, path))
    assert np.array_equal(window().act(observe(broken, own, path)), expected)
    assert np.isfinite(window().act(observe(np.full(RAYS, -np.inf)))).all()


def test_setpoints_are_those_of_the_table():
    for seed in range(20):
        ranges, own, path = random_scene(seed)
        yaw, speed = window().act(observe(ranges, own, path))[0]
        change = math.degrees(math.remainder(yaw - own[0, YAW], 2.0 * math.pi)) / 7.5
        assert change == pytest.approx(round(change), abs=1e-6)
        assert abs(round(change)) <= 4
        assert speed in (1.0, 2.5, 5.0)


def test_a_vessel_at_rest_gets_under_way(canal, sail):
    world, states = sail(window(), [canal(start_speed_mps=0.0)])

    assert world.outcome[0] == Outcome.SUCCESS
    assert states[:, 0, SURGE].max() > 4.5


def test_shipped_params_load():
    assert isinstance(load_dwa_params(), DwaParams)


def test_negative_weight_is_refused():
    with pytest.raises(ParamError, match='speed_weight'):
        DwaParams(speed_weight=-1.0)
