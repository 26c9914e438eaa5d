"""Named difficulties and vessel presets: what a random scenario is drawn from, read from YAML."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Literal

from portnav_ros.control.autopilot import AutopilotParams
from portnav_ros.params import ParamError, Ranges, check_ranges, override, read_yaml
from portnav_ros.planning.clearance_route import RouteCost
from portnav_ros.resources import config_path
from portnav_ros.sim.ports import Interval, PortParams
from portnav_ros.sim.scenario import LidarParams
from portnav_ros.sim.tracks import TrackParams
from portnav_ros.vessel import VesselParams

# What a vessel's file must say, since the way to a stop depends on it and nothing else stands for it.
OF_A_HULL = (
    'length_m',
    'beam_m',
    'mass_kg',
    'drag_kg_per_m',
    'thrust_max_n',
    'thrust_min_n',
    'thrust_rate_nps',
)


@dataclass(frozen=True)
class TrafficParams:
    """Other vessels: how many, how large, how fast, and how far from the own ship they begin."""

    vessels: int = 6
    length_m: Interval = (80.0, 135.0)
    length_over_beam: Interval = (8.0, 10.0)
    speed_mps: Interval = (2.5, 5.0)
    arrival: Literal['respawn', 'stop', 'vanish'] = 'respawn'
    start_gap_m: float = 200.0  # between any two vessels, and to the own ship, at t = 0
    clear_start_m: float = 150.0  # no vessel comes this close to the start ...
    clear_start_s: float = 60.0  # ... during the first seconds
    track: TrackParams = field(default_factory=TrackParams)
    ranges: ClassVar[Ranges] = {
        'vessels': (0, 100),
        'start_gap_m': (0.0, 5000.0),
        'clear_start_m': (0.0, 5000.0),
        'clear_start_s': (0.0, 3600.0),
    }

    def __post_init__(self) -> None:
        """Refuse values that are not traffic."""
        check_ranges(self)
        for name in ('length_m', 'length_over_beam', 'speed_mps'):
            low, high = getattr(self, name)
            if not 0.0 < low <= high:
                raise ParamError(f'{name} = [{low}, {high}] is not an interval of positive values')

    @property
    def beam_max_m(self) -> float:
        """Beam of the widest vessel."""
        return self.length_m[1] / self.length_over_beam[0]


@dataclass(frozen=True)
class Difficulty:
    """What a random scenario is drawn from, as in config/difficulties/*.yaml."""

    name: str = 'harbour'
    port: PortParams = field(default_factory=PortParams)
    traffic: TrafficParams = field(default_factory=TrafficParams)
    vessel: str = 'cemt_iv'  # preset in config/vessels, or a file
    lidar: LidarParams = field(default_factory=LidarParams)
    autopilot: AutopilotParams = field(default_factory=AutopilotParams)
    path: RouteCost = field(default_factory=RouteCost)
    path_length_m: Interval = (1500.0, 3000.0)
    rounding_m: float = 150.0  # reach of the mean that rounds the corners of a clearance route
    route: Literal['clearance', 'rrt_star'] = 'clearance'
    start_speed_mps: float = 2.0
    goal_radius_m: float = 50.0
    time_limit_s: float = 1200.0
    resets_per_port: int = 10
    ranges: ClassVar[Ranges] = {
        'rounding_m': (0.0, 5000.0),
        'start_speed_mps': (0.0, 50.0),
        'goal_radius_m': (1.0, 5000.0),
        'time_limit_s': (1.0, 1e6),
        'resets_per_port': (1, 10_000),
    }

    def __post_init__(self) -> None:
        """Refuse values from which no scenario can be drawn."""
        check_ranges(self)
        low, high = self.path_length_m
        if not 0.0 <= low < high:
            raise ParamError(f'path_length_m = [{low}, {high}] is not an interval of lengths')


def load_difficulty(name_or_path: str | Path) -> Difficulty:
    """Read a difficulty: a name in config/difficulties, or a YAML file; its vessel's file may lie beside it.

    Raises:
        ParamError: no such difficulty, an unknown key or a wrong type; names the file and the key.
    """
    path = preset_path('difficulties', name_or_path)
    difficulty = override(Difficulty(name=path.stem), read_yaml(path), str(path))
    beside = path.parent / difficulty.vessel
    return replace(difficulty, vessel=str(beside.resolve())) if beside.is_file() else difficulty


def load_vessel(name_or_path: str | Path) -> VesselParams:
    """Read a vessel preset: a name in config/vessels, or a YAML file.

    Raises:
        ParamError: no such preset, an unknown or missing key or a wrong type; names the file and the key.
    """
    path = preset_path('vessels', name_or_path)
    values = read_yaml(path)
    if missing := [key for key in OF_A_HULL if key not in values]:
        raise ParamError(
            f'{path}: {", ".join(missing)}: missing, and no two hulls have it alike; docs/vessel.md says how '
            'to measure it'
        )
    return override(VesselParams(name=path.stem), values, str(path))


def preset_path(folder: str, name_or_path: str | Path) -> Path:
    """Find config/FOLDER/NAME.yaml, or take a path that ends in .yaml or .yml as it is.

    Raises:
        ParamError: there is no such file.
    """
    path = Path(name_or_path)
    if path.suffix in ('.yaml', '.yml'):
        return path
    return config_path(folder, f'{name_or_path}.yaml')
