"""Equal rows of an array, found with a hash table."""

import secrets
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.compute.arrays import Bools, Ints, Ints32
from cascadenorm.compute.kernels import kernel

PRIME = 2**31 - 1


def first_equal(rows: NDArray[Any]) -> tuple[Ints, Bools] | None:
    """Return the first row equal to each, and whether it equals another, by bits; None if all rows differ."""
    bits = _bits(rows)
    same, repeated = np.empty(len(rows), np.int64), np.zeros(len(rows), bool)
    places = np.full(2 << len(rows).bit_length(), -1, np.int32)
    factors = np.array([1 + secrets.randbelow(PRIME - 1) for _ in range(3 * bits.shape[1])])
    return (same, repeated) if _find_equal(bits, factors, places, same, repeated) else None


def repeats(rows: NDArray[Any]) -> tuple[Bools, Ints]:
    """Return (k,) bool, the rows equal to an earlier one, and (k,) the first equal row of each."""
    every, found = np.arange(len(rows)), first_equal(rows)
    first = every if found is None else found[0]
    return first != every, first


def _bits(rows: NDArray[Any]) -> Ints:
    """Return the bits of each row as numbers of eight bytes; two numbers of single precision share one."""
    per_number = 2 if rows.dtype == np.float32 else 1
    width = rows.shape[1]
    padded = np.zeros((len(rows), width + -width % per_number), np.float32 if per_number == 2 else np.float64)
    with np.errstate(invalid="ignore"):  # signalling NaN
        np.add(rows, 0.0, out=padded[:, :width])  # -0 becomes 0
    return padded.view(np.int64)


@kernel
def _find_equal(rows: Ints, factors: Ints, places: Ints32, same: Ints, repeated: Bools) -> bool:
    """Find equal rows with a hash table, at most half full, with linear probing; return whether there are any.

    The hash is a sum of products with random factors (Carter, Wegman 1979), so that no file can provoke collisions.
    """
    any_repeated = False
    for i in range(len(rows)):
        # hash: multiply 22, 21 and 21 bits of each number by a factor, without overflow, reduce modulo a prime and mix
        slot = np.int64(0)
        for column in range(rows.shape[1]):
            number = rows[i, column]
            slot += (number & 0x3FFFFF) * factors[3 * column]
            slot += ((number >> 22) & 0x1FFFFF) * factors[3 * column + 1]
            slot += ((number >> 43) & 0x1FFFFF) * factors[3 * column + 2]
        slot = (slot % PRIME) * 0x7FEB352D
        slot = (slot ^ (slot >> 32)) & 0xFFFFFFFF

        # probe until the row or a free place is found
        slot &= len(places) - 1
        same[i] = i
        while places[slot] >= 0:
            differs, before = False, places[slot]
            for column in range(rows.shape[1]):
                differs |= rows[i, column] != rows[before, column]
            if not differs:
                same[i] = before
                repeated[i] = repeated[before] = any_repeated = True
                break
            slot = (slot + 1) & (len(places) - 1)
        if same[i] == i:
            places[slot] = i
    return any_repeated
