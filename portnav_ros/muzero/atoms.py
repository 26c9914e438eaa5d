"""Atoms of the categorical heads: values in raw reward units, and two-hot targets between them.

A head's expectation is the sum of its probabilities times the atoms themselves. MuZero (Schrittwieser
et al. 2020, appendix F) spaces its atoms evenly under h(x) = sign(x) (sqrt(|x| + 1) - 1) + 0.001 x and
takes the expectation there; a 30 % chance of -1000 then reads as -110. Here only the spacing is h's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from portnav_ros.params import ParamError, Ranges, check_ranges
from portnav_ros.types import Array, Array32

EPSILON = 0.001


@dataclass(frozen=True)
class AtomParams:
    """Number of atoms, their least and greatest value in units of reward, and how they are spaced."""

    count: int = 81
    least: float = -1500.0
    greatest: float = 1500.0
    spacing: Literal['h', 'linear'] = 'h'
    ranges: ClassVar[Ranges] = {'count': (2, 10_001), 'least': (-1e9, 1e9), 'greatest': (-1e9, 1e9)}

    def __post_init__(self) -> None:
        """Refuse fewer than two atoms and an empty range."""
        check_ranges(self)
        if not self.least < self.greatest:
            raise ParamError(f'least = {self.least} must lie below greatest = {self.greatest}')
        if self.spacing not in ('h', 'linear'):
            raise ParamError(f'spacing = {self.spacing!r} must be h or linear')

    def values(self) -> Array:
        """The atoms [count], rising, in raw units."""
        if self.spacing == 'linear':
            return np.linspace(self.least, self.greatest, self.count)
        return unsquash(np.linspace(squash(self.least), squash(self.greatest), self.count))


def squash(x: float) -> float:
    """h(x) of Pohlen et al. 2018."""
    return math.copysign(math.sqrt(abs(x) + 1.0) - 1.0, x) + EPSILON * x


def unsquash(y: Array) -> Array:
    """Invert h, elementwise."""
    root = (np.sqrt(1.0 + 4.0 * EPSILON * (np.abs(y) + 1.0 + EPSILON)) - 1.0) / (2.0 * EPSILON)
    return np.asarray(np.sign(y) * (root**2 - 1.0))


def two_hot(atoms: Array, values: Array) -> Array32:
    """Probabilities [..., count] over the two atoms next to each value [...]; their mean is the value.

    Values beyond the last atom are taken as that atom.
    """
    clipped = np.clip(values, atoms[0], atoms[-1])
    above = np.clip(np.searchsorted(atoms, clipped, side='right'), 1, len(atoms) - 1)
    share = (clipped - atoms[above - 1]) / (atoms[above] - atoms[above - 1])
    hot = np.zeros((*np.shape(values), len(atoms)), np.float32)
    np.put_along_axis(hot, above[..., None] - 1, (1.0 - share[..., None]).astype(np.float32), -1)
    np.put_along_axis(hot, above[..., None], share[..., None].astype(np.float32), -1)
    return hot
