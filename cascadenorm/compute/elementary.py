"""Exponentials and logarithms for kernels, suitable for vectorisation.

They use polynomials fitted at Chebyshev nodes of a small interval, and the exponent bits of the numbers. Unlike
numpy's functions, they give identical results on every processor.
"""

import numpy as np

from cascadenorm.compute.kernels import inlined, kernel

LOG2_E = float(np.log2(np.e))
ROUNDING = 1.5 * 2.0**52  # adding it to a number puts the nearest integer into the last bits of the sum
LOG_2_HIGH, LOG_2_LOW = 0.6931471803691238, 1.9082149292705877e-10
"""ln 2 in two parts; the product of the first part and an exponent is exact."""
SMALLEST = -708.0  # smaller arguments of `exp` give 0
E0, E1, E2, E3, E4, E5 = 1.0, 1.0, 0.5000000000000019, 0.1666666666666668, 0.04166666666648795, 0.008333333333319589
E6, E7, E8 = 0.0013888888952352863, 0.00019841269890076403, 2.4801485441561313e-05
E9, E10, E11 = 2.755724088722987e-06, 2.763265472252779e-07, 2.5110049204818658e-08

LOG2_E_SINGLE, LOG_2_SINGLE = np.float32(np.log2(np.e)), np.float32(np.log(2))
LARGEST_POWER = np.float32(126)
SIGNIFICAND, BIAS = np.int32(23), np.int32(127)  # number of significand bits and exponent bias in single precision
ROOT_HALF = np.int32(0x3F3504F3)  # bits of √½
P0, P1, P2, P3, P4, P5 = map(np.float32, (1.0000001, 0.6931472, 0.24022107, 0.05550327, 0.009676037, 0.0013400433))
L2, L3, L4, L5 = map(np.float32, (-0.5, 0.3333341, -0.2500092, 0.19985127))
L6, L7, L8, L9 = map(np.float32, (-0.16592856, 0.14676397, -0.14118426, 0.09272216))


@kernel
def exp(x: float) -> float:
    """Return e^x for x ≤ 700 with relative error 3e-16, as 2^n e^r with |r| ≤ ½ ln 2; 0 if x is below SMALLEST."""
    shifted = x * LOG2_E + ROUNDING
    n = shifted - ROUNDING
    r = x - n * LOG_2_HIGH - n * LOG_2_LOW
    power = np.int64((np.float64(shifted).view(np.int64) + 1023) << 52).view(np.float64)
    tail = E6 + r * (E7 + r * (E8 + r * (E9 + r * (E10 + r * E11))))
    result = power * (E0 + r * (E1 + r * (E2 + r * (E3 + r * (E4 + r * (E5 + r * tail))))))
    return 0.0 if x < SMALLEST else result


@inlined
def expf(x: np.float32) -> np.float32:
    """Return e^x in single precision, as 2^n 2^f with |f| ≤ ½, clamped to 2^-126 … 2^126.

    The relative error is at most 1e-6 for |x| ≤ 8, and 5e-6 everywhere.
    """
    exponent = min(max(x * LOG2_E_SINGLE, -LARGEST_POWER), LARGEST_POWER)
    n = np.rint(exponent)
    f = exponent - n
    power = np.int32((np.int32(n) + BIAS) << SIGNIFICAND).view(np.float32)
    result: np.float32 = power * (P0 + f * (P1 + f * (P2 + f * (P3 + f * (P4 + f * P5)))))
    return result


@kernel
def logf(x: np.float32) -> np.float32:
    """Return ln x in single precision for x > 0, as n ln 2 + ln(1 + r) with √½ ≤ 1 + r < √2.

    The error is at most 2e-6 for x from 1e-4 to 1e4.
    """
    bits = np.float32(x).view(np.int32)
    n = np.int32(bits - ROOT_HALF) >> SIGNIFICAND
    r = np.int32(bits - (n << SIGNIFICAND)).view(np.float32) - np.float32(1)
    tail = L3 + r * (L4 + r * (L5 + r * (L6 + r * (L7 + r * (L8 + r * L9)))))
    return np.float32(n) * LOG_2_SINGLE + (r + r * r * (L2 + r * tail))
