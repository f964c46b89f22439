"""Compiled passes over text: find words, parse decimals, replace words."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Bools, Bytes, Floats, Ints, kernel

Offsets = NDArray[np.signedinteger[Any]]

LARGEST_MANTISSA = 9 * 10**17
"""Decimals with a larger mantissa are parsed by Python. Ten times this number plus a digit still fits into 64 bits."""
SPLIT = 2.0**27 + 1  # factor that splits a double into halves of 26 bits
POWERS = np.array([10.0**e for e in range(23)])  # exact powers, so that one product or quotient rounds correctly


@kernel
def _is_space(byte: int) -> bool:
    return byte == 32 or 9 <= byte <= 13 or byte == 0


@kernel
def _join(data: Bytes, i: int) -> int:
    """Return the length of a backslash and the line end after it; 0 if there is none."""
    if data[i] != 92 or i + 1 == len(data):
        return 0
    if data[i + 1] == 13:
        return 3 if i + 2 < len(data) and data[i + 2] == 10 else 2
    return 2 if data[i + 1] == 10 else 0


@kernel
def find_words(
    data: Bytes, start: int, continued: bool, starts: Offsets, ends: Offsets, lines: Offsets
) -> tuple[int, int]:
    """Find the words from a byte on, and the first word of each non-empty line. Comments start with #.

    Fills the arrays from the beginning and returns the numbers of words and lines. If `continued`, a backslash at the
    end of a line joins it to the next one.
    """
    words = found_lines = 0
    fresh = True
    i = start
    while i < len(data):
        if _is_space(data[i]):
            # White space ends a word, a line end also ends a line.
            fresh = fresh or data[i] == 10 or data[i] == 13
            i += 1
        elif data[i] == 35:
            # A comment extends to the end of its line.
            while i < len(data) and data[i] != 10 and data[i] != 13:
                i += 1
        elif continued and _join(data, i):
            i += _join(data, i)
        else:
            # A word, which may be the first one of its line.
            if fresh:
                lines[found_lines] = words
                found_lines += 1
                fresh = False
            starts[words] = i
            while i < len(data) and not _is_space(data[i]) and not (continued and _join(data, i)):
                i += 1
            ends[words] = i
            words += 1
    return words, found_lines


@kernel
def begins_with(
    start: int, stop: int, data: Bytes, starts: Offsets, ends: Offsets, first: Offsets, keyword: Bytes, found: Bools
) -> None:
    """Test for each line whether its first word is the lower-case keyword, ignoring case."""
    for line in range(start, stop):
        place = starts[first[line]]
        same, i = ends[first[line]] - place == len(keyword), 0
        while same and i < len(keyword):
            same = data[place + i] | 32 == keyword[i]
            i += 1
        found[line] = same


@kernel
def decimals(start: int, stop: int, data: Bytes, starts: Offsets, ends: Offsets, values: Floats, simple: Bools) -> None:
    """Parse plain decimals of at most 18 digits whose power of ten is exact in double precision; skip the others."""
    for k in range(start, stop):
        i, end = starts[k], ends[k]
        simple[k] = False
        negative = i < end and data[i] == 45
        if negative or (i < end and data[i] == 43):
            i += 1
        # Parse digits with at most one point into an integer and a power of ten.
        mantissa = digits = exponent = 0
        seen_point = False
        while i < end and (48 <= data[i] <= 57 or (data[i] == 46 and not seen_point)):
            if data[i] == 46:
                seen_point = True
            else:
                mantissa = 10 * mantissa + int(data[i]) - 48
                digits += 1
                exponent -= seen_point
                if mantissa >= LARGEST_MANTISSA:
                    break
            i += 1
        if digits == 0 or mantissa >= LARGEST_MANTISSA:
            continue

        # Parse the exponent, if there is one.
        if i + 1 < end and (data[i] == 101 or data[i] == 69):
            i += 1
            down = data[i] == 45
            if down or data[i] == 43:
                i += 1
            power = 0
            if i == end:
                continue
            while i < end and 48 <= data[i] <= 57 and power < 1000:
                power = 10 * power + int(data[i]) - 48
                i += 1
            exponent += -power if down else power

        # A product or quotient of two exact numbers rounds once and is therefore correctly rounded.
        if i < end or exponent < -22 or exponent > 22:
            continue
        if mantissa < 1 << 53:
            value = mantissa / POWERS[-exponent] if exponent < 0 else mantissa * POWERS[exponent]
        elif exponent <= 0:
            value = _quotient(mantissa, POWERS[-exponent])
        else:
            continue
        values[k] = -value if negative else value
        simple[k] = value == value


@kernel
def _quotient(whole: int, power: float) -> float:
    """Divide an integer below LARGEST_MANTISSA by an exact power of ten (Dekker 1971); nan if rounding is uncertain."""
    high = float(whole)
    low = float(whole - int(high))
    first = high / power

    # The remainder of the first quotient: first · power is exact as a sum of products of 26-bit halves.
    product = first * power
    a, b = SPLIT * first, SPLIT * power
    first_high, power_high = a - (a - first), b - (b - power)
    first_low, power_low = first - first_high, power - power_high
    error = first_high * power_high - product + first_high * power_low + first_low * power_high + first_low * power_low
    second = (high - product - error + low) / power

    # If a slightly smaller and a slightly larger second quotient round alike, the sum is correctly rounded.
    least, most = first + second * (1 - 2.0**-50), first + second * (1 + 2.0**-50)
    return least if least == most else math.nan


@kernel
def splice(data: Bytes, starts: Offsets, ends: Offsets, letters: Bytes, begins: Ints, stops: Ints, out: Bytes) -> int:
    """Copy the data with the given words replaced by letters from begin to stop; return the length of the copy."""
    at = last = 0
    for k in range(len(starts)):
        for i in range(last, starts[k]):
            out[at] = data[i]
            at += 1
        for i in range(begins[k], stops[k]):
            out[at] = letters[i]
            at += 1
        last = ends[k]
    for i in range(last, len(data)):
        out[at] = data[i]
        at += 1
    return at
