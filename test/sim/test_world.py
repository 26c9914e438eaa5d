"""The batched world: determinism, independence of rows, outcomes."""

import dataclasses
import math

import numpy as np
import pytest
from shapely import box

from portnav_ros.control.autopilot import steer
from portnav_ros.harbour import Harbour
from portnav_ros.params import ParamError
from portnav_ros.sim.scenario import LidarParams, Scenario, ScenarioError, Tracks, Traffic
from portnav_ros.sim.world import TICK_S, World
from portnav_ros.types import SURGE, YAW, Outcome, X, Y
from portnav_ros.vessel import VesselParams

CANAL = Harbour('canal', box(0, -100, 2000, 100))


def scenario(**changes):
    return dataclasses.replace(Scenario('x', 0, CANAL, (100.0, 0.0, 0.0), (1900.0, 0.0)), **changes)


def crossing(at_x=500.0, speed=3.0, start_y=-90.0):
    y = np.arange(start_y, 91.0, 10.0)
    points = np.column_stack([np.full_like(y, at_x), y, np.full_like(y, math.pi / 2)]).astype(np.float32)
    tracks = Tracks(points, np.array([0, len(y)]), np.array([0]), np.array([1]))
    return Traffic(tracks, np.array([[40.0, 8.0]]), np.array([speed]), np.array([0]), np.array([0.0]))


def sail(world, setpoint, decisions):
    for _ in range(decisions):
        world.step(np.tile(setpoint, (world.batch, 1)))
    return world


def test_straight_run_reaches_the_goal():
    world = sail(World([scenario()]), (0.0, 5.0), 400)
    assert world.outcome[0] == Outcome.SUCCESS
    assert math.hypot(world.own[0, X] - 1900.0, world.own[0, Y]) == pytest.approx(50.0, abs=1.5)


def test_time_limit_ends_the_episode_and_time_stands_still():
    world = sail(World([scenario(time_limit_s=30.0)]), (0.0, 1.0), 40)
    assert world.outcome[0] == Outcome.TIMEOUT
    assert world.time_s[0] == pytest.approx(30.0)


def test_running_ashore_is_a_quay_collision_by_the_hull():
    world = sail(World([scenario()]), (math.pi / 2, 5.0), 60)
    assert world.outcome[0] == Outcome.COLLISION_QUAY
    bow = world.own[0, Y] + 0.5 * world.vessel.length_m * math.sin(world.own[0, YAW])
    assert 97.0 < bow < 103.0


def test_buoy_on_the_track_is_hit_and_a_pass_beside_it_is_not():
    def outcome(y):
        harbour = Harbour('b', CANAL.water, np.array([[500.0, y, 2.0]]), charted=np.array([False]))
        return sail(World([scenario(harbour=harbour)]), (0.0, 5.0), 400).outcome[0]

    beam = scenario().vessel.beam_m
    assert outcome(0.0) == Outcome.COLLISION_BUOY
    assert outcome(beam / 2 + 1.9) == Outcome.COLLISION_BUOY
    assert outcome(beam / 2 + 2.1) == Outcome.SUCCESS


def test_crossing_vessel_is_met_when_both_arrive_at_once():
    alone = World([scenario()])
    while alone.own[0, X] < 500.0:
        sail(alone, (0.0, 5.0), 1)
    together = crossing(speed=90.0 / alone.time_s[0])
    early = crossing(speed=3.0 * 90.0 / alone.time_s[0])
    assert sail(World([scenario(traffic=together)]), (0.0, 5.0), 400).outcome[0] == Outcome.COLLISION_VESSEL
    assert sail(World([scenario(traffic=early)]), (0.0, 5.0), 400).outcome[0] == Outcome.SUCCESS


def test_rows_are_independent():
    rng = np.random.default_rng(1)
    scenarios = [
        scenario(start=(100.0 + 50.0 * k, 10.0 * k, 0.1 * k), traffic=crossing(600.0 + k)) for k in range(3)
    ]
    together = World(scenarios)
    alone = [World([s]) for s in scenarios]
    for _ in range(60):
        setpoints = np.column_stack([rng.uniform(-0.5, 0.5, 3), rng.uniform(0.0, 5.0, 3)])
        together.step(setpoints)
        for b, world in enumerate(alone):
            world.step(setpoints[b : b + 1])
    for b, world in enumerate(alone):
        np.testing.assert_array_equal(together.own[b], world.own[0])
        np.testing.assert_array_equal(together.ranges[b], world.ranges[0])
        np.testing.assert_array_equal(together.clearance[b], world.clearance[0])


def test_ticks_with_the_autopilot_outside_equal_a_step_however_often_is_sensed():
    inside, outside = World([scenario(traffic=crossing())]), World([scenario(traffic=crossing())])
    memory, model, gains = np.zeros(2), outside.vessel.model(), outside.autopilot.gains()
    for _ in range(80):
        inside.step(np.array([[0.3, 5.0]]))
        for k in range(20):
            rudder, thrust = steer(gains, model, memory, outside.own[0], 0.3, 5.0, TICK_S)
            outside.tick(np.array([rudder]), np.array([thrust]))
            if k % 2:
                outside.sense()
    np.testing.assert_array_equal(inside.own, outside.own)
    np.testing.assert_array_equal(inside.ranges, outside.ranges)
    np.testing.assert_array_equal(inside.outcome, outside.outcome)


def test_port_and_starboard_are_mirror_images():
    port, starboard = World([scenario()]), World([scenario()])
    sail(port, (0.2, 5.0), 20)
    sail(starboard, (-0.2, 5.0), 20)
    np.testing.assert_allclose(port.own[0, [X, SURGE]], starboard.own[0, [X, SURGE]])
    np.testing.assert_allclose(port.own[0, Y], -starboard.own[0, Y])
    np.testing.assert_allclose(port.ranges[0, 1:], starboard.ranges[0, :0:-1], rtol=1e-5)


def test_ranges_in_a_canal_are_those_of_two_walls():
    world = World([scenario()])
    lidar = world.lidar
    angles = -math.pi + 2 * math.pi / lidar.rays * np.arange(lidar.rays)
    with np.errstate(divide='ignore'):
        walls = 100.0 / np.abs(np.sin(angles))
        astern = np.where(np.cos(angles) < 0, 100.0 / -np.cos(angles), np.inf)
    expected = np.minimum(walls, astern)
    expected[expected >= lidar.range_max_m] = np.inf
    np.testing.assert_allclose(world.ranges[0], expected, rtol=1e-5)


def test_clearance_is_the_gap_of_the_hull():
    world = World([scenario(start=(1000.0, 60.0, 0.0))])
    assert world.clearance[0, 0] == pytest.approx(100.0 - 60.0 - 0.5 * world.vessel.beam_m)


def test_reset_loads_a_larger_scenario():
    world = World([scenario(), scenario()])
    harbour = Harbour('b', CANAL.water.difference(box(900, -5, 910, 5)))
    world.step(np.array([[0.0, 5.0], [0.0, 5.0]]))
    before = world.own[0].copy()
    world.reset(1, scenario(harbour=harbour, traffic=crossing()))
    np.testing.assert_array_equal(world.own[0], before)
    assert world.own[1, X] == 100.0
    sail(world, (0.0, 5.0), 400)
    assert world.outcome.tolist() == [Outcome.SUCCESS, Outcome.COLLISION_QUAY]


def tick(world, thrust, seconds):
    """Sail under ticks alone: nothing is sensed after the reset."""
    for _ in range(round(seconds / TICK_S)):
        world.tick(np.zeros(1), np.array([thrust]))
    return world.outcome[0]


def test_contacts_are_found_by_ticks_that_are_never_sensed():
    full = scenario().vessel.thrust_max_n
    quay = scenario(start=(1000.0, 0.0, math.pi / 2), start_speed_mps=5.0)
    assert tick(World([quay]), full, 60.0) == Outcome.COLLISION_QUAY
    beyond_the_sensor = scenario(start=(1000.0, 0.0, 0.0), start_speed_mps=5.0, goal=(100.0, 0.0))
    assert tick(World([beyond_the_sensor]), full, 240.0) == Outcome.COLLISION_QUAY
    harbour = Harbour('b', CANAL.water, np.array([[500.0, 0.0, 2.0]]), charted=np.array([False]))
    buoy = scenario(harbour=harbour, start_speed_mps=5.0)
    assert tick(World([buoy]), full, 120.0) == Outcome.COLLISION_BUOY


def test_a_fast_vessel_is_felt_by_a_hull_at_rest_that_is_never_sensed():
    track = crossing().tracks
    lying_and_fast = Traffic(
        track, np.full((2, 2), (40.0, 8.0)), np.array([0.0, 20.0]), np.zeros(2, int), np.array([180.0, 0.0])
    )
    world = World([scenario(start=(500.0, 0.0, 0.0), traffic=lying_and_fast)])
    assert tick(world, 0.0, 8.0) == Outcome.COLLISION_VESSEL
    assert world.time_s[0] == pytest.approx((90.0 - 20.0 - 0.5 * world.vessel.beam_m) / 20.0, abs=0.25)


NOISY = LidarParams(noise_m=2.0, drop_out=0.1)


def noisy(seed):
    return scenario(seed=seed, lidar=NOISY)


def test_noise_without_traffic_follows_the_seed():
    first, again, other = (sail(World([noisy(seed)]), (0.0, 5.0), 3) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.own, other.own)
    np.testing.assert_array_equal(first.ranges, again.ranges)
    assert np.mean(first.ranges != other.ranges) > 0.5


def test_environments_without_traffic_have_noise_of_their_own():
    world = World([noisy(1), noisy(2)])
    assert np.mean(world.ranges[0] != world.ranges[1]) > 0.5
    world.reset(0, noisy(2))
    np.testing.assert_array_equal(world.ranges[0], world.ranges[1])


def test_noise_among_traffic_follows_the_seed_of_the_traffic():
    one, other = (World([dataclasses.replace(noisy(seed), traffic=crossing())]) for seed in (1, 2))
    np.testing.assert_array_equal(one.ranges, other.ranges)


def test_a_hull_shorter_than_its_way_between_two_looks_for_contacts_is_refused():
    dinghy = VesselParams(name='dinghy', length_m=1.0, beam_m=0.5)
    with pytest.raises(
        ScenarioError, match=r'dinghy: length_m = 1 .*1\.25 m .*speed_max_mps = 5\.00.*; raise'
    ):
        World([scenario(vessel=dinghy)])
    World([scenario(vessel=dataclasses.replace(dinghy, length_m=1.25))])


def test_scenarios_of_a_world_share_their_sensor():
    with pytest.raises(ScenarioError, match='share'):
        World([scenario(), scenario(lidar=LidarParams(rays=90))])
    with pytest.raises(ParamError, match='rays'):
        LidarParams(rays=2)
