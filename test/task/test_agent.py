"""An agent's policy sees and does at run time what it saw and did in the environment that trained it."""

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from portnav_ros.sim.scenario_files import load_scenario
from portnav_ros.sim.world import World
from portnav_ros.task.actions import ActionParams
from portnav_ros.task.agent import AgentPolicy
from portnav_ros.task.env import PortVectorEnv, TaskParams
from portnav_ros.task.observation import ObservationParams, Observer

TASKS = {
    'paper': TaskParams(),
    'held': TaskParams(ObservationParams(frames=3), ActionParams(hold=4)),
    'course': TaskParams(ObservationParams(layout='aligned'), ActionParams(reference='path', hold=3)),
}


class Recorder:
    """Decides by a fixed rule, and keeps what it was shown."""

    def __init__(self):
        self.seen = []

    def __call__(self, features):
        self.seen.append(features.copy())
        return np.array([7 * len(self.seen) % 27] * len(features))


@pytest.fixture(scope='module')
def scenarios():
    return [load_scenario(name, 4) for name in ('crossing', 'head_on')]


def sail(policy, scenarios, periods, replan_at=(), params=None):
    """Sail in the world for some periods; returns setpoints [T, B, 2]."""
    world, everyone = World(scenarios), np.ones(len(scenarios), bool)
    observer = Observer(len(scenarios), world.lidar, params or ObservationParams())
    observer.reset(everyone, [scenario.path for scenario in scenarios])
    policy.reset(everyone)
    given = []
    for period in range(periods):
        if period in replan_at:
            policy.reset(np.array([False, True]))
        setpoints = policy.act(observer.update(world.own, world.ranges, world.setpoint))
        world.step(setpoints)
        given.append(setpoints)
    return np.array(given)


@pytest.mark.parametrize('name', TASKS)
def test_the_agent_sees_what_the_environment_showed(name, scenarios):
    task, recorder = TASKS[name], Recorder()
    sources = iter([scenarios[0], scenarios[1]] * 2)  # once to build the environment, once to reset it
    env = PortVectorEnv(2, source=lambda _: next(sources), task=task, autoreset_mode=AutoresetMode.DISABLED)
    features, _ = env.reset()
    shown = []
    for _ in range(12):
        shown.append(features)
        features, *_ = env.step(np.array([7 * len(shown) % 27] * 2))
    policy = AgentPolicy(task.observation, task.actions, env.world.lidar, recorder)
    sail(policy, scenarios, 12 * task.actions.hold)
    np.testing.assert_array_equal(recorder.seen, shown)


def test_each_vessel_holds_from_its_own_reset(scenarios):
    recorder = Recorder()
    policy = AgentPolicy(ObservationParams(), ActionParams(hold=4), scenarios[0].lidar, recorder)
    given = sail(policy, scenarios, 9, replan_at=(2,))
    changed = (np.diff(given, axis=0) != 0.0).any(axis=2)  # [T - 1, B]
    assert np.flatnonzero(changed[:, 0]).tolist() == [3, 7]
    assert np.flatnonzero(changed[:, 1]).tolist() == [1, 5]
    assert [len(features) for features in recorder.seen] == [2, 1, 1, 1, 1]


def test_a_reset_forgets_older_frames(scenarios):
    params, recorder = ObservationParams(frames=3), Recorder()
    policy = AgentPolicy(params, ActionParams(), scenarios[0].lidar, recorder)
    sail(policy, scenarios, 6, replan_at=(5,))
    frames = recorder.seen[-1].reshape(2, 3, params.frame_size)
    assert not np.array_equal(frames[0, 0], frames[0, 1])
    np.testing.assert_array_equal(frames[1, 0], frames[1, 1])


def test_other_features_than_the_drivers_can_be_asked_for(scenarios):
    recorder = Recorder()
    policy = AgentPolicy(
        ObservationParams(frames=1, sectors=20), ActionParams(), scenarios[0].lidar, recorder
    )
    sail(policy, scenarios, 1, params=ObservationParams(sectors=90))
    assert recorder.seen[0].shape == (2, ObservationParams(frames=1, sectors=20).size)
