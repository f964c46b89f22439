"""Numbers as text, with the fewest digits from which their type gets them back.

The digits are found by R. Giulietti, "The Schubfach way to render doubles", 2022: a number times a power of ten, in 128
bits, is compared with the borders of the interval that rounds to it. The layout is that of repr in Python.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.io.text import blocks
from cascadenorm.mesh import Bytes, Floats, Ints, kernel, parallel_for

WIDTH = 32
"""Bytes for each word; the longest number takes 24."""
LEAST_POWER = -292
LOW = np.uint64(0xFFFFFFFF)
LARGEST = np.uint64(0xFFFFFFFFFFFFFFFF)
HALF, ZERO, ONE, TWO, FOUR, TEN, NOUGHT = (np.uint64(n) for n in (32, 0, 1, 2, 4, 10, ord("0")))

UInts = NDArray[np.uint64]


def _power(exponent: int) -> list[int]:
    """Return the leading 128 bits of a power of ten, rounded up, in two halves."""
    shift = (exponent * 1741647 >> 19) - 127
    above, below = 10 ** max(exponent, 0) << max(-shift, 0), 10 ** max(-exponent, 0) << max(shift, 0)
    bits = -(-above // below)
    return [bits >> 64, bits & (1 << 64) - 1]


POWERS = np.array([_power(exponent) for exponent in range(LEAST_POWER, 325)], np.uint64)


def spelled(values: NDArray[Any]) -> NDArray[np.bytes_]:
    """Spell each number of an array, row after row, as repr and numpy do."""
    flat = values.ravel()
    words = np.zeros((len(flat), WIDTH), np.uint8)
    if flat.dtype.kind in "iu":
        parallel_for(len(flat), _spell_integers, flat.astype(np.int64), words)
    else:
        single = flat.dtype == np.float32
        bits = flat.view(np.uint32 if single else np.uint64).astype(np.uint64)
        layout = (23, 150, 1e6) if single else (52, 1075, 1e16)
        with np.errstate(invalid="ignore"):  # a NaN may be a signalling one
            doubles = flat.astype(np.float64)
        parallel_for(len(flat), _spell_floats, doubles, bits, *layout, words)
    return words.view(f"S{WIDTH}")[:, 0]


def lines_of(keyword: bytes, *tables: NDArray[Any]) -> bytes:
    """Spell tables side by side, a line for each row, which begins with the keyword if that is not empty."""
    width, letters, parts = sum(table.shape[1] for table in tables), np.array(list(keyword), np.uint8), list[bytes]()
    for block in blocks(len(tables[0]), width):
        words = np.concatenate([spelled(table[block]).reshape(-1, table.shape[1]) for table in tables], axis=1)
        cells = words.view(np.uint8).reshape(len(words), width, WIDTH)
        out = np.empty(len(words) * (len(keyword) + 2) + cells.size + words.size, np.uint8)
        parts.append(out[: _join(cells, letters, out)].tobytes())
    return b"".join(parts)


def rows_of(values: NDArray[Any]) -> list[bytes]:
    """Spell the rows of a table, with spaces between the numbers."""
    return lines_of(b"", values).split(b"\n")[:-1]


@kernel
def _product(a: Any, b: Any) -> tuple[Any, Any]:
    """Return both halves of a product of 64 bits by 64."""
    low_a, high_a, low_b, high_b = a & LOW, a >> HALF, b & LOW, b >> HALF
    lowest = low_a * low_b
    middle = high_a * low_b + (lowest >> HALF)
    other = low_a * high_b + (middle & LOW)
    return high_a * high_b + (middle >> HALF) + (other >> HALF), other << HALF | lowest & LOW


@kernel
def _scaled(power: UInts, number: Any) -> Any:
    """Return power · number / 2¹²⁸, rounded to odd: the last bit is set where anything is cut off."""
    carried, _ = _product(power[1], number)
    high, low = _product(power[0], number)
    room = LARGEST - carried
    if low > room:
        high, low = high + ONE, low - room - ONE
    else:
        low += carried
    return high | ONE if low > ONE else high


@kernel
def _shortest(fraction: Any, exponent: Any, lower_is_closer: bool) -> tuple[Any, int]:
    """Return digits and a power of ten for fraction · 2^exponent; the digits may end in zeros."""
    k = (exponent * 1262611 - (524031 if lower_is_closer else 0)) >> 22
    shift = np.uint64(exponent + (-k * 1741647 >> 19) + 1)
    power = POWERS[-k - LEAST_POWER]
    odd, middle = fraction & ONE, FOUR * fraction
    below = _scaled(power, (middle - (ONE if lower_is_closer else TWO)) << shift) + odd
    value = _scaled(power, middle << shift)
    above = _scaled(power, (middle + TWO) << shift) - odd
    digits = value // FOUR
    if digits >= TEN:
        fewer = digits // TEN
        low, high = below <= FOUR * TEN * fewer, FOUR * TEN * (fewer + ONE) <= above
        if low != high:
            return fewer + (ONE if high else ZERO), k + 1
    low, high = below <= FOUR * digits, FOUR * (digits + ONE) <= above
    if low != high:
        return digits + (ONE if high else ZERO), k
    half = FOUR * digits + TWO
    up = value > half or (value == half and digits & ONE == ONE)
    return digits + (ONE if up else ZERO), k


@kernel
def _put_digits(number: Any, word: Bytes, at: int) -> int:
    """Write a whole number; the place after it."""
    count, rest = 1, number // TEN
    while rest > ZERO:
        count, rest = count + 1, rest // TEN
    for i in range(at + count - 1, at - 1, -1):
        word[i] = NOUGHT + number % TEN
        number //= TEN
    return at + count


@kernel
def _spell_integers(start: int, stop: int, values: Ints, words: Bytes) -> None:
    """Write each number into its row of words, which are zero before."""
    for i in range(start, stop):
        negative = values[i] < 0
        if negative:
            words[i, 0] = 45
        size = np.uint64(-(values[i] + 1)) + ONE if negative else np.uint64(values[i])
        _put_digits(size, words[i], 1 if negative else 0)


@kernel
def _spell_floats(
    start: int, stop: int, values: Floats, bits: UInts, mantissa: int, bias: int, large: float, words: Bytes
) -> None:
    """Write each number into its row of words, which are zero before.

    Parameters
    ----------
    values : (k,) the numbers, in double precision whatever their type
    bits : (k,) what represents them in their type
    mantissa, bias : of the type, the bits after the point, and what is added to the exponent of their last bit
    large : from which on numbers have an exponent
    words : (k, WIDTH)
    """
    hidden = ONE << np.uint64(mantissa)
    for i in range(start, stop):
        word, size, at = words[i], abs(values[i]), 0
        if np.signbit(values[i]) and not np.isnan(size):
            word[0], at = 45, 1
        if not np.isfinite(size):
            for letter in (110, 97, 110) if np.isnan(size) else (105, 110, 102):
                word[at] = letter
                at += 1
            continue
        digits, power = ZERO, 0
        if size > 0:
            fraction = bits[i] & (hidden - ONE)
            exponent = np.int64(bits[i] >> np.uint64(mantissa)) & (2 * (bias - mantissa) + 1)
            closer = bool(fraction == ZERO and exponent > 1)
            if exponent > 0:
                fraction |= hidden
            digits, power = _shortest(fraction, (exponent if exponent > 0 else 1) - bias, closer)
            while digits % TEN == ZERO:
                digits //= TEN
                power += 1
        _lay_out(digits, power, size == 0 or 1e-4 <= size < large, word, at)


@kernel
def _lay_out(digits: Any, power: int, plain: bool, word: Bytes, at: int) -> None:
    """Write digits · 10^power from a place on, plainly or with an exponent."""
    if plain and power >= 0:
        at = _put_digits(digits, word, at)
        for _ in range(power):
            word[at] = 48
            at += 1
        word[at], word[at + 1] = 46, 48
        return
    first = at
    end = _put_digits(digits, word, at)
    point = end - first + power if plain else 1  # digits before the point
    if point <= 0:
        shift = 2 - point
        for i in range(end - 1, first - 1, -1):
            word[i + shift] = word[i]
        for i in range(first, first + shift):
            word[i] = 48
        word[first + 1] = 46
        return
    if end - first > point:
        for i in range(end - 1, first + point - 1, -1):
            word[i + 1] = word[i]
        word[first + point] = 46
    if plain:
        return
    exponent = end - first - 1 + power
    at = end + 1 if end - first > 1 else end
    word[at], word[at + 1] = 101, 45 if exponent < 0 else 43
    exponent = abs(exponent)
    at += 2
    if exponent < 10:
        word[at] = 48
        at += 1
    _put_digits(np.uint64(exponent), word, at)


@kernel
def _join(words: Bytes, keyword: Bytes, out: Bytes) -> int:
    """Write lines, each of a keyword, which may be empty, and a row of words, (lines, words, WIDTH); their length."""
    at = 0
    for line in range(len(words)):
        for i in range(len(keyword)):
            out[at] = keyword[i]
            at += 1
        for column in range(words.shape[1]):
            if column or len(keyword):
                out[at] = 32
                at += 1
            for i in range(words.shape[2]):
                if words[line, column, i] == 0:
                    break
                out[at] = words[line, column, i]
                at += 1
        out[at] = 10
        at += 1
    return at
