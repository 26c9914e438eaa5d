"""The episode that a bag tells: topics joined into the rows of an EpisodeLog."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from portnav_ros.charts import read_geojson
from portnav_ros.evaluation.bag_writer import BagError
from portnav_ros.evaluation.bags import Bag, read_bag
from portnav_ros.evaluation.episode_log import EpisodeLog, ScanLog, TargetTrack
from portnav_ros.harbour import ChartError
from portnav_ros.params import ParamError, override
from portnav_ros.types import Array, Outcome
from portnav_ros.vessel import VesselParams

CHART = 'chart.geojson'  # lies beside the storage file
# Keys of the bag's metadata; those of the first row become fields of the log, the rest stays metadata.
SEED, SCENARIO, DIFFICULTY, PLANNER = 'seed', 'scenario', 'difficulty', 'planner'
GOAL, GOAL_RADIUS, VESSEL, HULLS = 'goal', 'goal_radius_m', 'vessel', 'hulls'
RENAMED = 'renamed'  # names in the bag of topics that were remapped, and their own ones
LOST = 'lost'  # in the log's metadata: what a damaged bag lacks
_OWN_KEYS = {SEED, SCENARIO, DIFFICULTY, PLANNER, GOAL, GOAL_RADIUS, VESSEL, HULLS, RENAMED}


def read_episode(path: Path) -> EpisodeLog:
    """Read a bag that `portnav up` or `portnav demo` has recorded.

    Where no sim judged the episode, the goal is the end of the last plan, and a vessel that ends within the
    goal's radius has reached it.

    Args:
        path: the bag's folder or the folder that holds ``bag/``.

    Raises:
        BagError: no odometry or no plan in it, or its metadata or chart is missing or damaged.
    """
    bag = read_bag(path)
    renamed = json.loads(bag.metadata.get(RENAMED, '{}'))
    topics = {renamed.get(name, name.rsplit('/', 1)[-1]): rows for name, rows in bag.messages.items()}
    odometry = topics.get('odom', [])
    if not odometry:
        raise BagError(f'{bag.path}: no odometry was recorded; was the vessel ever under way?')
    stamps, first = np.unique([stamp for stamp, _ in odometry], return_index=True)
    time_s = stamps * 1e-9
    own = np.zeros((len(stamps), 7))
    own[:, :5] = [_motion(odometry[row][1]) for row in first]
    joints = _joined(topics.get('joint_states', []), _joints, stamps)
    if joints is not None:
        own[:, 5:7] = joints
    setpoint = _joined(topics.get('setpoint', []), _setpoint, stamps)
    scans, plan, facts = topics.get('scan', []), _plan(bag, topics.get('plan', [])), _facts(bag)
    outcome = _outcome(topics.get('episode', []))
    if not topics.get('episode'):
        facts['goal'] = tuple(plan[-1].tolist())
        there = math.dist(own[-1, :2], plan[-1]) <= facts['goal_radius_m']
        outcome = Outcome.SUCCESS if there else Outcome.RUNNING
    return EpisodeLog(
        time_s=time_s,
        own=own,
        setpoint=np.column_stack((own[:, 2], own[:, 3])) if setpoint is None else setpoint,
        path=plan,
        outcome=outcome,
        command=_joined(topics.get('cmd_actuators', []), _joints, stamps),
        range_min=_range_min(scans, stamps),
        targets=_targets(bag, topics.get('targets', [])),
        scans=_scan_log(scans),
        **facts,
    )


def _facts(bag: Bag) -> dict[str, Any]:
    """Fields that come from the bag's metadata and chart."""
    metadata = bag.metadata
    try:
        x_m, y_m = json.loads(metadata[GOAL])
        rest = {key: value for key, value in metadata.items() if key not in _OWN_KEYS}
        return {
            'harbour': read_geojson(bag.path / CHART),
            'goal': (x_m, y_m),
            'goal_radius_m': float(metadata[GOAL_RADIUS]),
            'vessel': override(VesselParams(), json.loads(metadata[VESSEL]), f'{bag.path}: {VESSEL}'),
            'seed': int(metadata[SEED]),
            'scenario': metadata[SCENARIO],
            'difficulty': metadata[DIFFICULTY],
            'planner': metadata[PLANNER],
            'metadata': rest | ({LOST: bag.lost} if bag.lost else {}),
        }
    except KeyError as error:
        raise BagError(
            f'{bag.path}/metadata.yaml: key {error} is missing; record with `portnav up` or `portnav demo`'
        ) from error
    except (ParamError, ChartError, ValueError) as error:
        raise BagError(f'{bag.path}: {error}') from error


def _joined(rows: Sequence[tuple[int, Any]], read: Any, stamps: Any) -> Array | None:
    """Values [T, n] that held at each stamp: the last before it, or the first of all; None without rows."""
    if not rows:
        return None
    own_stamps = np.array([stamp for stamp, _ in rows])
    last = np.searchsorted(own_stamps, stamps, side='right') - 1
    values = np.array([read(message) for _, message in rows], np.float64)
    return np.asarray(values[np.maximum(last, 0)], np.float64)


def _yaw(orientation: Any) -> float:
    return 2.0 * math.atan2(orientation.z, orientation.w)


def _motion(message: Any) -> tuple[float, ...]:
    pose, twist = message.pose.pose, message.twist.twist
    yaw_rad = math.remainder(_yaw(pose.orientation), math.tau)
    return pose.position.x, pose.position.y, yaw_rad, twist.linear.x, twist.angular.z


def _setpoint(message: Any) -> tuple[float, float]:
    yaw_rad = math.remainder(_yaw(message.pose.pose.orientation), math.tau)
    return yaw_rad, message.twist.twist.linear.x


def _joints(message: Any) -> tuple[float, float]:
    names = list(message.name)
    return message.position[names.index('rudder')], message.effort[names.index('propulsion')]


def _plan(bag: Bag, rows: Sequence[tuple[int, Any]]) -> Array:
    paths = [message.poses for _, message in rows if len(message.poses) > 1]
    if not paths:
        raise BagError(f'{bag.path}: no plan was recorded; the log of the global planner says why')
    return np.array([(p.pose.position.x, p.pose.position.y) for p in paths[-1]])


def _outcome(rows: Sequence[tuple[int, Any]]) -> Outcome:
    values = [pair.value for _, message in rows for pair in message.values if pair.key == 'outcome']
    return Outcome[values[-1]] if values else Outcome.RUNNING


def _range_min(rows: Sequence[tuple[int, Any]], stamps: Any) -> Array | None:
    return _joined(rows, lambda message: np.nanmin(message.ranges, initial=np.inf), stamps)


def _scan_log(rows: Sequence[tuple[int, Any]]) -> ScanLog | None:
    if not rows:
        return None
    first = rows[0][1]
    same = [(stamp, m.ranges) for stamp, m in rows if len(m.ranges) == len(first.ranges)]
    return ScanLog(
        np.array([stamp for stamp, _ in same]) * 1e-9,
        np.array([ranges for _, ranges in same], np.float32),
        first.angle_min,
        first.angle_increment,
    )


def _targets(bag: Bag, rows: Sequence[tuple[int, Any]]) -> tuple[TargetTrack, ...]:
    tracks: dict[str, list[tuple[float, ...]]] = {}
    for stamp, message in rows:
        tracks.setdefault(message.child_frame_id, []).append((stamp * 1e-9, *_motion(message)[:4]))
    hulls = json.loads(bag.metadata.get(HULLS, '[]'))
    found = []
    for name, track in sorted(tracks.items()):
        number, values = name.rsplit('/', 1)[-1], np.array(track)
        known = number.isdigit() and int(number) < len(hulls)
        length_m, beam_m = hulls[int(number)] if known else (0.0, 0.0)
        found.append(TargetTrack(name, values[:, 0], values[:, 1:], length_m, beam_m))
    return tuple(found)
