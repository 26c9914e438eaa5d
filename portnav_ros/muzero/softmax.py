"""Exponentials of a row, written so that the compiler turns the loop into vector instructions."""

from __future__ import annotations

import numpy as np
from numba import njit

from portnav_ros.types import Array32

LOG2_E = np.float32(1.4426950408889634)
LN2_HIGH = np.float32(0.693359375)  # exact in a few bits, so that n * LN2_HIGH is exact too
LN2_LOW = np.float32(-2.12194440054690583e-4)
LOWEST = np.float32(-87.0)
HALF = np.float32(0.5)
ONE = np.float32(1.0)
C3, C4, C5, C6, C7 = (np.float32(1.0 / f) for f in (6, 24, 120, 720, 5040))


@njit(cache=True, fastmath={'contract', 'reassoc', 'nsz'})
def exp_row(row: Array32, start: int, stop: int) -> np.float32:
    """Replace row[start:stop] by exp(x - max x) and return its sum.

    exp(x) = 2^n exp(r) with |r| <= ln(2) / 2, where a Taylor polynomial of degree 7 is exact to float32;
    2^n is added to the exponent bits. Relative error below 3e-7; anything below exp(-87) counts as that.
    """
    bits = row.view(np.int32)
    top = row[start]
    for i in range(start, stop):
        top = max(top, row[i])
    total = np.float32(0.0)
    for i in range(start, stop):
        x = max(row[i] - top, LOWEST)
        n = np.int32(x * LOG2_E - HALF)
        r = x - np.float32(n) * LN2_HIGH - np.float32(n) * LN2_LOW
        row[i] = ONE + r * (ONE + r * (HALF + r * (C3 + r * (C4 + r * (C5 + r * (C6 + r * C7))))))
        bits[i] += np.int32(n << np.int32(23))
        total += row[i]
    return total
