"""The episode that a bag tells: topics joined into the rows of an EpisodeLog."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from portnav_ros.charts import read_geojson
from portnav_ros.evaluation.bag_writer import BagError
from portnav_ros.evaluation.bags import Bag, read_bag
from portnav_ros.evaluation.episode_log import EpisodeLog, PlanLog, ScanLog, TargetTrack
from portnav_ros.geometry import yaw_of
from portnav_ros.harbour import ChartError
from portnav_ros.params import ParamError, override
from portnav_ros.safety.mounting import Mounting
from portnav_ros.types import SURGE, YAW, Array, IntArray, Outcome
from portnav_ros.vessel import VesselParams

Value = TypeVar('Value')
Kind = TypeVar('Kind', dict[str, Any], list[Any])
SECOND = 1e-9  # of a ns

CHART = 'chart.geojson'  # lies beside the storage file
# Keys of the bag's metadata; those of the first row become fields of the log, the rest stays metadata.
SEED, SCENARIO, DIFFICULTY, PLANNER = 'seed', 'scenario', 'difficulty', 'planner'
GOAL, GOAL_RADIUS, VESSEL, HULLS = 'goal', 'goal_radius_m', 'vessel', 'hulls'
MOUNTING = 'mounting'  # of the ranging sensor, where it is not in the middle of the hull
RENAMED = 'renamed'  # names in the bag of topics that were remapped, and their own ones
LOST = 'lost'  # in the log's metadata: what a damaged bag lacks
_OWN_KEYS = {SEED, SCENARIO, DIFFICULTY, PLANNER, GOAL, GOAL_RADIUS, VESSEL, HULLS, MOUNTING, RENAMED}


def read_episode(path: Path) -> EpisodeLog:
    """Read a bag that `portnav up` or `portnav demo` has recorded.

    Where no sim judged the episode, the goal is the end of the last plan, and a vessel that ends within the
    goal's radius has reached it. It begins with the first plan: what lies at its berth before does not count.
    What cannot be used, such as a pose that is not finite, is left out, and the log's metadata says so.

    Args:
        path: the bag's folder or the folder that holds ``bag/``.

    Raises:
        BagError: no odometry or no plan in it, or its metadata or chart is missing or damaged.
    """
    bag = read_bag(path)
    topics = _Topics(bag)
    odometry = topics.read('odom', _motion)
    if not len(odometry[0]):
        raise BagError(f'{bag.path}: no odometry was recorded; was the vessel ever under way?')
    plans = _plans(bag, *topics.read_each('plan', _route))
    stamps, motion = _once(*odometry, since_ns=plans[0][0])
    if not len(stamps):
        raise BagError(f'{bag.path}: no odometry was recorded after the plan; was the vessel ever under way?')
    joints = _joined(*topics.read('joint_states', _joints), stamps)
    own = np.column_stack((motion, np.full((len(stamps), 2), np.nan) if joints is None else joints))
    setpoint = _joined(*topics.read('setpoint', _setpoint), stamps)
    command = _joined(*topics.read('cmd_actuators', _joints), stamps)
    targets, scans = topics.read_each('targets', _target), topics.read_each('scan', _sweep)
    plan, facts = plans[-1][1], _facts(bag)
    endings = topics.read_each('episode', _ending)[1]
    if endings:
        outcome = endings[-1]
    else:
        facts['goal'] = tuple(plan[-1].tolist())
        there = math.dist(own[-1, :2], plan[-1]) <= facts['goal_radius_m']
        outcome = Outcome.SUCCESS if there else Outcome.RUNNING
    hulls, mounting = facts.pop(HULLS), facts.pop(MOUNTING)
    lost = '; '.join(filter(None, (bag.lost, topics.refused())))
    facts['metadata'] |= {LOST: lost} if lost else {}
    return EpisodeLog(
        time_s=_seconds(stamps),
        own=own,
        setpoint=np.column_stack((own[:, YAW], own[:, SURGE])) if setpoint is None else setpoint,
        path=plan,
        earlier_plans=tuple(PlanLog(stamp * SECOND, points) for stamp, points in plans[:-1]),
        path_since_s=plans[-1][0] * SECOND,
        outcome=outcome,
        command=command,
        range_min=_range_min(*scans, stamps),
        targets=_targets(*targets, hulls),
        scans=_scan_log(*scans, mounting),
        **facts,
    )


class _Topics:
    """Messages of a bag by the names of the table, and how many of them nobody can use.

    A recorder files what was published; the nodes themselves refuse some of it.
    """

    def __init__(self, bag: Bag) -> None:
        try:
            renamed = json.loads(bag.metadata.get(RENAMED, '{}'))
            names = {name: renamed.get(name, name.rsplit('/', 1)[-1]) for name in bag.messages}
        except (ValueError, AttributeError) as error:
            raise BagError(f'{bag.path}/metadata.yaml: {RENAMED}: {error}') from error
        self._rows = {names[name]: rows for name, rows in bag.messages.items()}
        self._refused: Counter[str] = Counter()

    def read_each(self, topic: str, read: Callable[[Any], Value]) -> tuple[IntArray, list[Value]]:
        """Stamps [N] in ns and values [N] of the messages that can be used."""
        stamps, values = [], []
        for stamp, message in self._rows.get(topic, ()):
            try:
                value = read(message)
            except (ValueError, LookupError):
                self._refused[topic] += 1
            else:
                stamps.append(stamp)
                values.append(value)
        return np.array(stamps, np.int64), values

    def read(self, topic: str, read: Callable[[Any], tuple[float, ...]]) -> tuple[IntArray, Array]:
        """Stamps [N] in ns and numbers [N, n] of the messages that can be used."""
        stamps, values = self.read_each(topic, lambda message: _finite(read(message)))
        return stamps, np.array(values, np.float64)

    def refused(self) -> str:
        """How many messages were left out, in words."""
        return ', '.join(f'{count} that cannot be used on {topic}' for topic, count in self._refused.items())


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
            'vessel': override(VesselParams(), _of(metadata, VESSEL, dict), f'{bag.path}: {VESSEL}'),
            'seed': int(metadata[SEED]),
            'scenario': metadata[SCENARIO],
            'difficulty': metadata[DIFFICULTY],
            'planner': metadata[PLANNER],
            HULLS: [(float(length_m), float(beam_m)) for length_m, beam_m in _of(metadata, HULLS, list)],
            MOUNTING: override(Mounting(), _of(metadata, MOUNTING, dict), f'{bag.path}: {MOUNTING}'),
            'metadata': rest,
        }
    except KeyError as error:
        raise BagError(
            f'{bag.path}/metadata.yaml: key {error} is missing; record with `portnav up` or `portnav demo`'
        ) from error
    except (ParamError, ChartError, ValueError, TypeError) as error:
        raise BagError(f'{bag.path}: {error}') from error


def _of(metadata: Mapping[str, str], key: str, kind: type[Kind]) -> Kind:
    """What JSON says under a key of the metadata, or nothing where a key that may be missing is."""
    value = json.loads(metadata[key] if key == VESSEL else metadata.get(key, json.dumps(kind())))
    if not isinstance(value, kind):
        raise ValueError(f'{key}: expected a {kind.__name__}, got {value!r}')
    return value


def _once(stamps: IntArray, values: Array, since_ns: int) -> tuple[IntArray, Array]:
    """Rows in the order of their stamps, each stamp once, from a time on."""
    stamps, first = np.unique(stamps, return_index=True)
    late = stamps >= since_ns
    return stamps[late], values[first[late]]


def _joined(own_stamps: IntArray, values: Array, stamps: IntArray) -> Array | None:
    """Values [T, n] that held at each stamp: the last before it, or the first of all; None without any."""
    if not len(own_stamps):
        return None
    last = np.searchsorted(own_stamps, stamps, side='right') - 1
    return np.asarray(values[np.maximum(last, 0)], np.float64)


def _seconds(stamps: IntArray) -> Array:
    return np.asarray(stamps * SECOND, np.float64)


def _finite(values: tuple[float, ...]) -> tuple[float, ...]:
    if not all(map(math.isfinite, values)):
        raise ValueError(f'{values} are not all finite')
    return values


def _yaw(orientation: Any) -> float:
    return yaw_of(orientation.x, orientation.y, orientation.z, orientation.w)


def _motion(message: Any) -> tuple[float, ...]:
    pose, twist = message.pose.pose, message.twist.twist
    return pose.position.x, pose.position.y, _yaw(pose.orientation), twist.linear.x, twist.angular.z


def _target(message: Any) -> tuple[str, tuple[float, ...]]:
    return message.child_frame_id, _finite(_motion(message)[:4])


def _setpoint(message: Any) -> tuple[float, float]:
    return _yaw(message.pose.pose.orientation), message.twist.twist.linear.x


def _joints(message: Any) -> tuple[float, float]:
    names = list(message.name)
    return message.position[names.index('rudder')], message.effort[names.index('propulsion')]


def _route(message: Any) -> Array:
    """Points [W, 2] m; none where there is no way, or the plan was taken back."""
    return np.array([_finite((p.pose.position.x, p.pose.position.y)) for p in message.poses]).reshape(-1, 2)


def _ending(message: Any) -> Outcome:
    return Outcome[{pair.key: pair.value for pair in message.values}['outcome']]


def _sweep(message: Any) -> Any:
    if not len(message.ranges) or not math.isfinite(message.angle_min + message.angle_increment):
        raise ValueError('a scan without rays')
    return message


def _plans(bag: Bag, stamps: IntArray, routes: Sequence[Array]) -> list[tuple[int, Array]]:
    """Plans and the stamps in ns from which on they held; one that says what held already is left out."""
    found: list[tuple[int, Array]] = []
    for stamp, points in zip(stamps.tolist(), routes, strict=True):
        if len(points) > 1 and not (found and np.array_equal(found[-1][1], points)):
            found.append((stamp, points))
    if not found:
        raise BagError(f'{bag.path}: no plan was recorded; the log of the global planner says why')
    return found


def _range_min(own_stamps: IntArray, sweeps: Sequence[Any], stamps: IntArray) -> Array | None:
    least = np.array([np.nanmin(sweep.ranges, initial=np.inf) for sweep in sweeps])
    return _joined(own_stamps, least, stamps)


def _scan_log(stamps: IntArray, sweeps: Sequence[Any], mounting: Mounting) -> ScanLog | None:
    if not sweeps:
        return None
    first = sweeps[0]
    same = [k for k, sweep in enumerate(sweeps) if len(sweep.ranges) == len(first.ranges)]
    return ScanLog(
        _seconds(stamps[same]),
        np.array([sweeps[k].ranges for k in same], np.float32),
        first.angle_min,
        first.angle_increment,
        mounting,
    )


def _targets(
    stamps: IntArray, poses: Sequence[tuple[str, tuple[float, ...]]], hulls: Sequence[tuple[float, float]]
) -> tuple[TargetTrack, ...]:
    tracks: dict[str, list[tuple[float, ...]]] = {}
    for stamp, (name, pose) in zip(stamps.tolist(), poses, strict=True):
        tracks.setdefault(name, []).append((stamp * SECOND, *pose))
    found = []
    for name, track in sorted(tracks.items()):
        number, values = name.rsplit('/', 1)[-1], np.array(track)
        known = number.isdigit() and int(number) < len(hulls)
        length_m, beam_m = hulls[int(number)] if known else (0.0, 0.0)
        found.append(TargetTrack(name, values[:, 0], values[:, 1:], length_m, beam_m))
    return tuple(found)
