import numpy as np
import pytest
from shapely.geometry import box

from portnav_ros.harbour import Harbour
from portnav_ros.sim.scenario import Scenario
from portnav_ros.sim.world import World
from portnav_ros.task.observation import ObservationParams, Observer


@pytest.fixture(scope='session')
def canal():
    """Build a straight canal along x, 1 km long, with a path along its axis y = 0."""

    def build(width_m=300.0, buoys=(), start=(60.0, 0.0, 0.0), **scenario):
        rows = np.array(buoys, float).reshape(-1, 3)
        water = box(0.0, -0.5 * width_m, 1000.0, 0.5 * width_m)
        harbour = Harbour('canal', water, buoys=rows, charted=np.zeros(len(rows), bool))
        path = np.column_stack([np.arange(60.0, 901.0, 10.0), np.zeros(85)])
        defaults = {'start_speed_mps': 4.0, 'path': path}
        return Scenario('canal', 0, harbour, start, (900.0, 0.0), **(defaults | scenario))

    return build


@pytest.fixture(scope='session')
def sail():
    """Sail scenarios to their ends; return the world and the states [T, B, 7]."""

    def run(policy, scenarios):
        world = World(scenarios)
        everyone = np.ones(len(scenarios), bool)
        observer = Observer(len(scenarios), world.lidar, ObservationParams())
        observer.reset(everyone, [scenario.path for scenario in scenarios])
        policy.reset(everyone)
        if hasattr(policy, 'prepare'):
            for b, scenario in enumerate(scenarios):
                policy.prepare(b, scenario)
        states = [world.own.copy()]
        while (world.outcome == 0).any():
            world.step(policy.act(observer.update(world.own, world.ranges, world.setpoint)))
            states.append(world.own.copy())
        return world, np.array(states)

    return run
