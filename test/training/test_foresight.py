"""The privileged teacher, on worlds where the answer is known."""

import dataclasses
import math

import numpy as np
import pytest

from portnav_ros.params import ParamError
from portnav_ros.sim.difficulty import load_difficulty
from portnav_ros.sim.generator import make_scenario
from portnav_ros.sim.scenario_files import load_scenario
from portnav_ros.task.actions import ActionParams
from portnav_ros.task.env import PortVectorEnv, TaskParams
from portnav_ros.training.foresight import Extrapolation, Foresight, ForesightParams, best_of, regret_of
from portnav_ros.types import Outcome

OFFSETS = tuple(math.radians(a) for a in (-45.0, -20.0, 0.0, 20.0, 45.0))
ACTIONS = ActionParams(OFFSETS, (1.0, 5.0), reference='path', hold=4)
AHEAD = 5  # no offset, full speed
ALL = np.arange(ACTIONS.count)


def sailing(name, count=2, **params):
    env = PortVectorEnv(
        count, source=lambda rng: load_scenario(name, int(rng.integers(50))), task=TaskParams(actions=ACTIONS)
    )
    env.reset(seed=3)
    return env, Foresight(env.world, ACTIONS, ForesightParams(**params))


def values(env, teacher, vessels):
    return teacher.value(env.observation, vessels, np.tile(ALL, (len(vessels), 1)))


def outcomes(env, teacher, decisions=200):
    """How the first episode of every environment ends under the teacher's best actions."""
    first = np.zeros(env.num_envs, int)
    everyone = np.arange(env.num_envs)
    for _ in range(decisions):
        ended = env.step(values(env, teacher, everyone).argmax(axis=1))[4]['outcome']
        first = np.where(first == 0, ended, first)
        teacher.look(ended > 0)
        if first.all():
            return first
    return first


def test_without_traffic_nothing_but_path_and_time_counts():
    env, teacher = sailing('no_traffic')
    for _ in range(20):
        env.step(np.full(2, AHEAD))
    found = values(env, teacher, np.arange(2))
    fast, slow = found[:, 1::2], found[:, 0::2]
    assert (fast >= slow).all()
    assert (found.max(axis=1) - found[:, AHEAD] < 10.0).all()
    assert (found.max(axis=1) - found.min(axis=1) < 100.0).all()


@pytest.mark.parametrize('name', ['slow_head_on', 'one_buoy', 'buoy_field', 'half_crossing'])
def test_the_teacher_avoids_what_line_of_sight_runs_into(name):
    env, teacher = sailing(name, count=6)
    assert (outcomes(env, teacher) == 1).all()


def test_a_collision_ahead_costs_what_it_should():
    env, teacher = sailing('one_buoy', 1, collision=1000.0, certain_s=60.0, closeness=0.0)
    for _ in range(200):
        lesson = values(env, teacher, np.arange(1))[0]
        if lesson.max() - lesson[AHEAD] > 500.0:
            break
        env.step(np.array([AHEAD]))
    assert 800.0 < lesson.max() - lesson[AHEAD] < 1100.0


def test_a_row_does_not_depend_on_the_others():
    env, teacher = sailing('slow_head_on', 4)
    for _ in range(10):
        env.step(np.full(4, AHEAD))
    together = values(env, teacher, np.arange(4))
    for b in (2, 0):
        np.testing.assert_array_equal(values(env, teacher, np.array([b]))[0], together[b])


def test_teaching_disturbs_nothing():
    env, teacher = sailing('half_crossing', 3)
    before = {name: array.copy() for name, array in env.state_dict().items()}
    teacher.look(np.ones(3, dtype=bool))
    lesson = teacher.teach(env.observation, np.arange(3), 4, np.random.default_rng(0))
    for name, array in env.state_dict().items():
        np.testing.assert_array_equal(array, before[name], err_msg=name)
    assert (lesson.action[:, 0] == AHEAD).all()
    assert all(len(set(row)) == 4 for row in lesson.action)


def test_regret_is_none_for_the_best():
    env, teacher = sailing('one_buoy', 3)
    lesson = teacher.teach(env.observation, np.arange(3), 6, np.random.default_rng(1))
    regret = regret_of(lesson)
    assert regret.min() == 0.0
    at = [list(row).index(best) for row, best in zip(lesson.action, best_of(lesson), strict=True)]
    np.testing.assert_array_equal(regret[np.arange(3), at], 0.0)


def test_what_cannot_be_seen_is_not_told():
    """With a sensor that reaches no vessel, the head-on one is not in the lesson."""

    def short(rng):
        scenario = load_scenario('slow_head_on', int(rng.integers(50)))
        return dataclasses.replace(scenario, lidar=dataclasses.replace(scenario.lidar, range_max_m=20.0))

    env = PortVectorEnv(1, source=short, task=TaskParams(actions=ACTIONS))
    env.reset(seed=3)
    blind = Foresight(env.world, ACTIONS, ForesightParams())
    outcome = outcomes(env, blind)
    assert outcome[0] == 4


def test_vessels_are_where_it_was_told_that_they_would_be():
    easy = dataclasses.replace(load_difficulty('easy'), route='clearance')
    env = PortVectorEnv(
        2, source=lambda rng: make_scenario(easy, int(rng.integers(50))), task=TaskParams(actions=ACTIONS)
    )
    env.reset(seed=3)
    teacher = Foresight(env.world, ACTIONS, ForesightParams())
    compared = 0
    for second in range(1, 181):
        env.world.step(np.zeros((2, 2)))
        afloat = env.world.outcome == Outcome.RUNNING
        compared += afloat.sum()
        np.testing.assert_allclose(env.world.vessels[afloat], teacher.poses[afloat, second], atol=1e-6)
    assert compared > 180


def test_bad_holds_are_refused():
    with pytest.raises(ParamError, match='holds_s'):
        ForesightParams(holds_s=(20, 8))
    env, _ = sailing('no_traffic', 1)
    with pytest.raises(ParamError, match='reference'):
        Foresight(env.world, ActionParams(), ForesightParams())


def test_extrapolation_knows_the_present_and_no_turn():
    env, teacher = sailing('half_crossing')
    guess = Extrapolation(env.world, ACTIONS, ForesightParams())
    for _ in range(4):
        env.step(np.full(2, AHEAD))
    now = np.rint(env.world.time_s).astype(int)
    true, guessed = teacher.future(env.world.time_s)[0], guess.future(env.world.time_s)[0]
    present = true[np.arange(2), now]
    np.testing.assert_array_equal(guessed[:, 0], present)
    moved = guessed[:, 10, :, :2] - guessed[:, 0, :, :2]
    np.testing.assert_allclose(np.hypot(*moved.T), 10.0 * present[..., 3].T)
    np.testing.assert_allclose(np.arctan2(moved[..., 1], moved[..., 0]), present[..., 2], atol=1e-9)
    assert not np.allclose(guessed[:, 60], true[np.arange(2), now + 60], atol=5.0)  # it stops across the path
