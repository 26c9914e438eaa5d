"""The Gymnasium environments."""

import dataclasses

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import portnav_ros.task.env
from portnav_ros.params import ParamError
from portnav_ros.sim.scenario import ScenarioError
from portnav_ros.sim.scenario_files import load_scenario
from portnav_ros.task.actions import ActionParams
from portnav_ros.task.env import PortEnv, PortVectorEnv, TaskParams
from portnav_ros.task.observation import ObservationParams
from portnav_ros.task.reward import RewardParams, reward_terms
from portnav_ros.types import Outcome

STRAIGHT = 14  # heading kept, 5 m/s


def vector(count=3, **options):
    return PortVectorEnv(count, 'easy', ports=2, **options)


def test_environment_passes_the_checker():
    env = gymnasium.make('portnav_ros/Port-v0', difficulty='easy', ports=1)
    check_env(env.unwrapped, skip_render_check=True)


def test_make_vec_gives_the_batched_world():
    envs = gymnasium.make_vec('portnav_ros/Port-v0', num_envs=4, difficulty='easy', ports=1)
    features, _ = envs.reset(seed=1)
    assert isinstance(envs.unwrapped, PortVectorEnv)
    assert features.shape == (4, envs.single_observation_space.shape[0])


def test_same_seed_same_episode():
    first, second = vector(), vector()
    first.reset(seed=7)
    second.reset(seed=7)
    for _ in range(50):
        a, b = first.step(np.full(3, STRAIGHT)), second.step(np.full(3, STRAIGHT))
        np.testing.assert_array_equal(a[0], b[0])
        np.testing.assert_array_equal(a[1], b[1])


def test_rows_do_not_depend_on_the_batch():
    alone, together = vector(1), vector(3)
    alone.reset(seed=5)
    together.reset(seed=[3, 4, 5])
    for _ in range(30):
        a, b = alone.step(np.full(1, STRAIGHT)), together.step(np.full(3, STRAIGHT))
        np.testing.assert_array_equal(a[0][0], b[0][2])


@pytest.mark.parametrize('layout', ['stacked', 'aligned'])
def test_copies_sail_on_as_what_they_are_copies_of(layout):
    task = TaskParams(ObservationParams(layout=layout, tracks=4 if layout == 'aligned' else 0))
    env, copies = vector(task=task), vector(4, task=task, autoreset_mode=AutoresetMode.DISABLED)
    env.reset(seed=7)
    rng = np.random.default_rng(0)
    for _ in range(40):
        env.step(rng.integers(27, size=3))
    rows = np.array([2, 0, 2])
    copies.copy(env, rows)
    for actions in rng.choice([5, 14, 23], size=(25, 3)):
        a, b = env.step(actions), copies.step(np.append(actions[rows], STRAIGHT))
        for mine, other in zip(a[:4], b[:4], strict=True):
            np.testing.assert_array_equal(mine[rows], other[:3])
        np.testing.assert_array_equal(a[4]['errors'][rows], b[4]['errors'][:3])


def test_a_copy_makes_room_for_a_larger_port():
    small, large = (PortVectorEnv(count, 'easy', ports=1, seed=count) for count in (2, 1))
    sizes = [env.world.walls.shape[1:] for env in (small, large)]
    assert sizes[0] != sizes[1]
    for copied, copies in ((small, large), (large, small)):
        copied.reset(seed=1)
        rows = np.zeros(copies.num_envs, np.int64)
        copies.copy(copied, rows)
        for _ in range(5):
            a = copied.step(np.full(copied.num_envs, STRAIGHT))
            b = copies.step(np.full(copies.num_envs, STRAIGHT))
            np.testing.assert_array_equal(a[0][rows], b[0])


def test_a_copy_of_another_vessel_is_refused():
    barge, shuttle = (
        PortVectorEnv(1, source=lambda rng, name=name: load_scenario(name, 0))
        for name in ('head_on', 'rough_canal')
    )
    assert barge.world.vessel != shuttle.world.vessel
    with pytest.raises(ScenarioError, match='share its vessel'):
        shuttle.copy(barge, np.zeros(1, np.int64))


def run_until_an_end(env, limit=2000):
    env.reset(seed=0)
    for _ in range(limit):
        result = env.step(np.full(env.num_envs, STRAIGHT))
        if (result[2] | result[3]).any():
            return result
    raise AssertionError('no episode ended')


def test_collision_is_terminated_and_followed_by_a_new_episode_in_the_same_step():
    env = vector()
    features, reward, terminated, truncated, infos = run_until_an_end(env)
    b = int(np.flatnonzero(terminated)[0])
    assert not truncated[b]
    assert reward[b] == pytest.approx(infos['reward_terms'][b].sum())
    assert Outcome(infos['outcome'][b]).collision == (reward[b] < -900.0)
    assert infos['_final_obs'][b]
    assert not np.array_equal(infos['final_obs'][b], features[b])
    assert env.world.outcome[b] == Outcome.RUNNING
    assert env.world.time_s[b] == 0.0


def test_time_limit_is_truncated_not_terminated():
    short = dataclasses.replace(load_scenario('no_traffic'), time_limit_s=20.0)
    env = PortVectorEnv(1, source=lambda _: short)
    env.reset()
    results = [env.step(np.array([STRAIGHT])) for _ in range(20)]
    assert [bool(result[3][0]) for result in results] == [False] * 19 + [True]
    assert not any(result[2][0] for result in results)
    assert results[-1][4]['outcome'][0] == Outcome.TIMEOUT
    assert results[-1][1][0] > -100.0


def test_without_autoreset_an_ended_vessel_waits_for_its_mask():
    env = vector(2, autoreset_mode=AutoresetMode.DISABLED)
    _, _, terminated, truncated, _ = run_until_an_end(env)
    ended = terminated | truncated
    before = env.world.own.copy()
    env.reset(options={'reset_mask': ended})
    assert (env.world.outcome == Outcome.RUNNING).all()
    np.testing.assert_array_equal(env.world.own[~ended], before[~ended])


@pytest.mark.parametrize('mode', [AutoresetMode.SAME_STEP, AutoresetMode.DISABLED])
def test_a_mode_may_be_given_by_its_value(mode):
    env = vector(1, autoreset_mode=mode.value)
    assert env.metadata['autoreset_mode'] is mode
    *_, infos = run_until_an_end(env)
    assert ('final_obs' in infos) == (mode is AutoresetMode.SAME_STEP)


@pytest.mark.parametrize('mode', [AutoresetMode.NEXT_STEP, 'NextStep', 'never', None])
def test_a_mode_that_does_not_exist_here_is_refused(mode):
    with pytest.raises(ParamError, match=r'autoreset_mode = .* must be AutoresetMode\.SAME_STEP'):
        vector(1, autoreset_mode=mode)


def test_a_seed_may_be_an_integer_of_numpy():
    env = vector()
    expected, _ = env.reset(seed=3)
    for seed in (np.int64(3), np.array([3, 4, 5]), [3, np.int32(4), 5]):
        features, _ = env.reset(seed=seed)
        np.testing.assert_array_equal(features, expected)


def test_an_action_out_of_range_is_refused():
    env = vector(1)
    env.reset(seed=0)
    with pytest.raises(gymnasium.error.InvalidAction):
        env.step(np.array([27]))


@pytest.mark.parametrize(
    'actions', [np.full(2, 14.0), np.ones(2, dtype=bool), np.full(2, -1), np.full(3, 14)]
)
def test_what_does_not_number_an_action_of_each_vessel_is_refused(actions):
    env = vector(2)
    env.reset(seed=0)
    with pytest.raises(gymnasium.error.InvalidAction, match='2 integers from 0 to 26'):
        env.step(actions)


def test_a_single_action_that_is_no_integer_is_refused():
    env = PortEnv(difficulty='easy', ports=1)
    env.reset(seed=0)
    with pytest.raises(gymnasium.error.InvalidAction):
        env.step(14.0)


def test_a_step_before_the_first_reset_is_refused():
    with pytest.raises(gymnasium.error.ResetNeeded):
        vector(2).step(np.full(2, STRAIGHT))
    with pytest.raises(gymnasium.error.ResetNeeded):
        vector(2).reset(options={'reset_mask': np.array([True, False])})
    with pytest.raises(gymnasium.error.ResetNeeded):
        PortEnv(difficulty='easy', ports=1).step(STRAIGHT)


@pytest.mark.parametrize('mask', [np.array([0, 1, 0]), np.array([True, False]), np.array([0.0, 1.0, 0.0])])
def test_a_mask_that_is_not_a_boolean_of_each_vessel_is_refused(mask):
    env = vector(3)
    env.reset(seed=0)
    before = env.world.own.copy()
    with pytest.raises(ParamError, match=r'reset_mask of type .* must be of type bool and shape \(3,\)'):
        env.reset(options={'reset_mask': mask})
    np.testing.assert_array_equal(env.world.own, before)


def test_environments_reset_without_a_seed_are_not_alike():
    envs = [PortEnv(difficulty='easy', ports=1) for _ in range(3)]
    starts = [env.reset()[0] for env in envs]
    assert not np.array_equal(starts[0], starts[1]) or not np.array_equal(starts[0], starts[2])


def test_resets_after_a_seeded_one_draw_on():
    first, second = (PortEnv(difficulty='easy', ports=1) for _ in range(2))
    for seed in (3, None, None):
        a, b = first.reset(seed=seed)[0], second.reset(seed=seed)[0]
        np.testing.assert_array_equal(a, b)


def test_what_was_last_told_of_an_ended_episode_is_its_final_info():
    _, _, terminated, truncated, infos = run_until_an_end(vector())
    ended = terminated | truncated
    final = infos['final_info']
    np.testing.assert_array_equal(infos['_final_info'], ended)
    for key in ('outcome', 'errors', 'reward_terms'):
        np.testing.assert_array_equal(final[key][ended], infos[key][ended])
        np.testing.assert_array_equal(final[f'_{key}'], ended)
    assert (final['outcome'][ended] != Outcome.RUNNING).all()


def test_a_scenario_without_a_path_is_refused():
    with pytest.raises(ScenarioError, match='path'):
        PortVectorEnv(1, source=lambda _: dataclasses.replace(load_scenario('no_traffic'), path=None))


def test_module_registers_the_environment():
    assert portnav_ros.task.env.gymnasium.spec('portnav_ros/Port-v0').vector_entry_point is not None


def test_a_held_action_is_its_setpoint_given_again():
    held = vector(task=TaskParams(actions=ActionParams(hold=3)))
    single = vector()
    held.reset(seed=1)
    single.reset(seed=1)
    actions = np.array([5, 20, 14])
    _, reward, _, _, infos = held.step(actions)
    _, total, _, _, _ = single.step(actions)
    for _ in range(2):
        single.world.step(held.world.setpoint)
        single.observe()
        total += reward_terms(RewardParams(), single._info()['errors'], single.world.outcome).sum(axis=1)
    np.testing.assert_array_equal(single.world.own, held.world.own)
    np.testing.assert_allclose(reward, total)
    np.testing.assert_allclose(reward, infos['reward_terms'].sum(axis=1))


@pytest.mark.parametrize('layout', ['stacked', 'aligned'])
def test_a_restored_environment_goes_on_alike_through_new_episodes(layout):
    task = TaskParams(ObservationParams(layout=layout))
    first, second = vector(task=task), vector(task=task)
    first.reset(seed=7)
    second.reset(seed=1)
    rng = np.random.default_rng(0)
    for _ in range(40):
        first.step(rng.integers(27, size=3))
    second.load_state_dict(first.state_dict())
    ended = 0
    for actions in rng.choice([2, 5, 14, 23], size=(300, 3)):
        a, b = first.step(actions), second.step(actions)
        for mine, other in zip(a[:4], b[:4], strict=True):
            np.testing.assert_array_equal(mine, other)
        np.testing.assert_array_equal(a[4]['errors'], b[4]['errors'])
        ended += int((a[2] | a[3]).sum())
    assert ended > 0
