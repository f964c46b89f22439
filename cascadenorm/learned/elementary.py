"""Exponential and logarithm in single precision, for kernels: loops over them become vector instructions.

The polynomials interpolate at Chebyshev nodes. Results are the same on every processor, which numpy's are not.
"""

import numpy as np

from cascadenorm.mesh import kernel

LOG2_E, LOG_2 = np.float32(np.log2(np.e)), np.float32(np.log(2))
LARGEST = np.float32(126)
"""Powers of 2 beyond which exponentials stay as they are."""
ROOT_HALF = np.int32(0x3F3504F3)
"""Bits of √½, from which on a mantissa counts to the next power of 2."""
EXPONENT = np.int32(23)
"""Bits behind the exponent of a number."""
BIAS = np.int32(127)
"""What is added to an exponent."""
E0, E1, E2, E3, E4, E5 = map(np.float32, (1.0000001, 0.6931472, 0.24022107, 0.05550327, 0.009676037, 0.0013400433))
L2 = np.float32(-0.5)
L3, L4, L5, L6, L7, L8, L9 = map(
    np.float32, (0.3333341, -0.2500092, 0.19985127, -0.16592856, 0.14676397, -0.14118426, 0.09272216)
)


@kernel
def exp(x: np.float32) -> np.float32:
    """Return e^x to 3e-7 of it, as 2^n 2^f with |f| ≤ ½; between 2^-126 and 2^126."""
    power = min(max(x * LOG2_E, -LARGEST), LARGEST)
    n = np.rint(power)
    f = power - n
    factor = np.int32((np.int32(n) + BIAS) << EXPONENT).view(np.float32)
    return factor * (E0 + f * (E1 + f * (E2 + f * (E3 + f * (E4 + f * E5)))))


@kernel
def log(x: np.float32) -> np.float32:
    """Return ln x to 1e-6, as n ln 2 + ln(1 + r) with √½ ≤ 1 + r < √2; x is a positive number."""
    bits = np.float32(x).view(np.int32)
    n = np.int32(bits - ROOT_HALF) >> EXPONENT
    r = np.int32(bits - (n << EXPONENT)).view(np.float32) - np.float32(1)
    tail = L3 + r * (L4 + r * (L5 + r * (L6 + r * (L7 + r * (L8 + r * L9)))))
    return np.float32(n) * LOG_2 + (r + r * r * (L2 + r * tail))
