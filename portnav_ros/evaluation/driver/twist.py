"""Does the twist fit the pose? Differences of the pose tell in which frame, sense and unit it is sent."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from portnav_ros.evaluation.driver.record import DriverRecord, Expected, Finding, Motion, motion
from portnav_ros.types import Array

WINDOW_S = 1.0  # of one difference: long against the noise of a position, short against a turn
LEAST_WINDOWS = 10
LEAST_SPEED_MPS = 0.3
LEAST_RATE_RADPS = 0.01
SPEED_TOLERANCE, RATE_TOLERANCE = (0.1, 0.1), (0.02, 0.2)  # absolute, and relative to the median
KNOT_MPS = 1852.0 / 3600.0
BODY = 'in the body frame'


class Windows(NamedTuple):
    """Means over windows [N]: moved [N, 2] m/s in map, and what the messages said meanwhile."""

    moved: Array
    turned_radps: Array
    yaw_rad: Array
    said: Array
    said_radps: Array


def check_twist(record: DriverRecord, _: Expected) -> Finding:
    """The linear velocity is in the body frame: the pose's differences, turned by -yaw."""
    name, windows = 'twist', _windows(motion(record.odometry))
    speed = np.hypot(*windows.moved.T)
    under_way = speed > LEAST_SPEED_MPS
    if np.sum(under_way) < LEAST_WINDOWS:
        found = f'the vessel made less than {LEAST_SPEED_MPS} m/s: check under way, or with --move'
        return Finding(name, 'left out', found)
    moved, yaw, said = windows.moved[under_way], windows.yaw_rad[under_way], windows.said[under_way]
    bound = SPEED_TOLERANCE[0] + SPEED_TOLERANCE[1] * float(np.median(speed[under_way]))
    errors = {
        what: float(np.median(np.hypot(*(moved - guess).T))) for what, guess in _guesses(yaw, said).items()
    }
    best = min(errors, key=errors.__getitem__)
    found = (
        f'{errors[BODY]:.2f} m/s from the differences of the pose, at {np.median(speed[under_way]):.1f} m/s'
    )
    if errors[BODY] <= bound:
        if errors['in the map frame'] <= bound:
            return Finding(
                name, 'left out', 'bow to the east, body and map frame agree: check on another course'
            )
        return Finding(name, 'ok', found)
    if errors[best] <= bound:
        return Finding(
            name, 'fail', f'{best}: {found}', 'turn the velocity into base_link: m/s, x to the bow, y to port'
        )
    return Finding(
        name, 'fail', found, 'pose and twist must tell of one motion: frames, units, signs, delays'
    )


def check_yaw_rate(record: DriverRecord, _: Expected) -> Finding:
    """The yaw rate is that of the yaw: rad/s, counter-clockwise."""
    windows = _windows(motion(record.odometry))
    turned, said = windows.turned_radps, windows.said_radps
    if len(turned) < LEAST_WINDOWS:
        return Finding('yaw rate', 'left out', 'too short a record')
    bound = RATE_TOLERANCE[0] + RATE_TOLERANCE[1] * float(np.median(np.abs(turned)))
    error = float(np.median(np.abs(turned - said)))
    found = f'{error:.3f} rad/s from the differences of the yaw'
    for what, factor in (('of the opposite sign', -1.0), ('in degrees', np.pi / 180.0)):
        if error > bound and float(np.median(np.abs(turned - factor * said))) <= bound:
            return Finding(
                'yaw rate', 'fail', f'{what}: {found}', 'rad/s, positive where the bow turns to port'
            )
    if error > bound:
        return Finding(
            'yaw rate', 'fail', found, 'yaw and yaw rate must tell of one motion: units, signs, delays'
        )
    if np.max(np.abs(turned)) < LEAST_RATE_RADPS:
        return Finding('yaw rate', 'left out', 'the vessel hardly turned: check in a turn')
    return Finding('yaw rate', 'ok', found)


def _guesses(yaw: Array, said: Array) -> dict[str, Array]:
    """Velocities [N, 2] in map, if the twist were sent in each of these ways."""
    return {
        BODY: _turned(yaw, said),
        'in the map frame': said,
        'of the opposite sign': _turned(yaw, -said),
        'with y to starboard': _turned(yaw, said * [1.0, -1.0]),
        'of a yaw that is a compass heading': _turned(0.5 * np.pi - yaw, said),
        'in knots': _turned(yaw, KNOT_MPS * said),
    }


def _turned(angle: Array, vectors: Array) -> Array:
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.column_stack(
        [cosine * vectors[:, 0] - sine * vectors[:, 1], sine * vectors[:, 0] + cosine * vectors[:, 1]]
    )


def _windows(track: Motion) -> Windows:
    """Differences over windows of WINDOW_S that hold no gap."""
    first = np.arange(len(track.stamp_s))
    last = np.searchsorted(track.stamp_s, track.stamp_s + WINDOW_S - 1e-6)
    first, last = first[last < len(first)], last[last < len(first)]
    span = track.stamp_s[last] - track.stamp_s[first]
    whole = span < 1.5 * WINDOW_S
    first, last, span = first[whole], last[whole], span[whole]

    def change(values: Array) -> Array:
        return ((values[last] - values[first]).T / span).T

    return Windows(
        change(track.position),
        change(track.yaw_rad),
        change(_integral(track.stamp_s, track.yaw_rad)),
        change(_integral(track.stamp_s, track.velocity)),
        change(_integral(track.stamp_s, track.yaw_rate_radps)),
    )


def _integral(time_s: Array, values: Array) -> Array:
    """Integral from the first sample, by trapezes."""
    pieces = (0.5 * (values[1:] + values[:-1]).T * np.diff(time_s)).T
    return np.concatenate([np.zeros_like(values[:1]), np.cumsum(pieces, axis=0)])
