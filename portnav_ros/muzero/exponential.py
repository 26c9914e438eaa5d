"""exp(x) in float32, of operations that a compiler can turn into vector instructions."""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

LOG2_E = np.float32(1.4426950408889634)
LN2_HIGH = np.float32(0.693359375)  # exact in a few bits, so that n * LN2_HIGH is exact too
LN2_LOW = np.float32(-2.12194440054690583e-4)
LEAST = np.float32(-87.0)
HALF, ONE = np.float32(0.5), np.float32(1.0)
C3, C4, C5, C6, C7 = (np.float32(1.0 / factorial) for factorial in (6, 24, 120, 720, 5040))
BIAS, MANTISSA = np.int32(127), np.int32(23)


@intrinsic
def _as_float32(_context: Any, bits: Any) -> Any:
    """Read 32 bits as a float."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], ir.FloatType())

    return types.float32(types.int32), generate


@njit(cache=True, error_model='numpy', fastmath={'contract', 'nsz', 'nnan'})
def exp_negative(x: np.float32) -> np.float32:
    """exp(x) for x <= 0, relative error below 3e-7; anything below -87 counts as that.

    exp(x) = 2^n exp(r) with |r| <= ln(2) / 2, where a Taylor polynomial of degree 7 is exact to float32;
    the bits of 2^n are its exponent alone.
    """
    x = max(x, LEAST)
    n = np.int32(x * LOG2_E - HALF)
    r = x - np.float32(n) * LN2_HIGH - np.float32(n) * LN2_LOW
    series = ONE + r * (ONE + r * (HALF + r * (C3 + r * (C4 + r * (C5 + r * (C6 + r * C7))))))
    return series * _as_float32(np.int32((n + BIAS) << MANTISSA))
