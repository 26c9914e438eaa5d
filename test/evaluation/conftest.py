"""Synthetic recordings with known figures."""

from collections.abc import Callable

import numpy as np
import pytest
from shapely.geometry import Polygon, box

from portnav_ros.evaluation.episode_log import EpisodeLog, ScanLog, TargetTrack
from portnav_ros.harbour import Harbour
from portnav_ros.types import STATE_SIZE, SURGE, Outcome, X, Y


@pytest.fixture
def basin() -> Harbour:
    water = Polygon([(-50, -200), (700, -200), (700, 250), (420, 250), (420, 150), (-50, 150)])
    buoys = np.array([[250.0, 60.0, 3.0], [400.0, -80.0, 3.0]])
    berths = np.array([[0.0, -190.0, 0.0]])
    pier = box(100, -200, 180, -120)
    return Harbour('test basin', water.difference(pier), buoys, berths, np.array([True, False]))


@pytest.fixture
def straight(basin: Harbour) -> Callable[..., EpisodeLog]:
    """Make a log of a vessel that sails east at 5 m/s, `offset_m` north of its plan, for 100 s."""

    def make(offset_m: float = 0.0, period_s: float = 1.0, **changes: object) -> EpisodeLog:
        time_s = np.arange(0.0, 100.0 + 0.5 * period_s, period_s)
        own = np.zeros((len(time_s), STATE_SIZE))
        own[:, X], own[:, Y], own[:, SURGE] = 5.0 * time_s, offset_m, 5.0
        path = np.column_stack([np.arange(0.0, 541.0, 10.0), np.zeros(55)])
        pose = np.column_stack([600.0 - 4.0 * time_s, np.full_like(time_s, 90.0)])
        pose = np.column_stack([pose, np.full_like(time_s, np.pi), np.full_like(time_s, 4.0)])
        fields = {
            'time_s': time_s,
            'own': own,
            'setpoint': np.tile([0.0, 5.0], (len(time_s), 1)),
            'clearance': np.column_stack([200.0 - time_s, 300.0 - time_s, 150.0 - time_s]),
            'path': path,
            'harbour': basin,
            'goal': (540.0, 0.0),
            'outcome': Outcome.SUCCESS,
            'targets': (TargetTrack('1', time_s, pose, 80.0, 10.0),),
            'scans': ScanLog(
                time_s[::10], np.full((len(time_s[::10]), 36), 90.0, np.float32), -np.pi, np.pi / 18
            ),
            'latency_s': np.linspace(0.0, 0.1, 101),
            'wall_s': 2.0,
            'seed': 7,
            'planner': 'dwa',
            'difficulty': 'easy',
        }
        return EpisodeLog(**{**fields, **changes})

    return make
