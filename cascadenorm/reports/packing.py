"""Compact text for arrays of integers: differences, split into planes of bytes, deflated and encoded in base64."""

import zlib
from base64 import b64encode
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

MOST_CODES = 1 << 16
LARGEST_VALUE = 1e300  # size above which a number counts as unknown, so that differences do not overflow
VALUE_STEPS = 250  # number of steps up to the 99th percentile of the absolute values of a quantity


class SteppedValues(NamedTuple):
    """Real numbers rounded to integer codes: value = start + step · (code - 1); code 0 stands for an unknown value."""

    codes: NDArray[np.int32]
    start: float
    step: float


def in_steps(values: NDArray[np.float64], steps: int = VALUE_STEPS) -> SteppedValues:
    """Round values to steps of 1 / `steps` of their usual range; NaN marks unknown values.

    The step is longer if the largest value would otherwise need more than MOST_CODES, so no value is clipped.
    """
    known = np.abs(values) < LARGEST_VALUE
    if not known.any():
        return SteppedValues(np.zeros(values.shape, np.int32), 0.0, 1.0)
    start, stop = float(values[known].min()), float(values[known].max())
    usual = float(np.quantile(np.abs(values[known]), 0.99))
    step = max(usual / steps, (stop - start) / (MOST_CODES - 2)) or 1.0
    codes = np.rint((np.where(known, values, start) - start) / step).astype(np.int32) + 1
    return SteppedValues(np.where(known, codes, 0), start, step)


def packed(values: NDArray[np.signedinteger[Any]], *, differences: bool = False) -> dict[str, Any]:
    """Pack integers, (k,) or (k, c), column by column. Twice their differences must fit into their type.

    With `differences`, each value except the first of a column is stored as its difference from the previous one,
    which is smaller if neighbours are similar. Returns the shape, `differences`, the number of bytes of each value,
    and as data the base64 of the deflated bytes: first the lowest byte of every value, then the next one.
    """
    columns = values.reshape(len(values), -1).T
    if differences:
        columns = np.diff(columns, axis=1, prepend=columns.dtype.type(0))
    size = columns.itemsize
    folded = (columns << 1) ^ (columns >> (8 * size - 1))  # 0, -1, 1, -2, … to 0, 1, 2, 3, …
    width = max(1, -(-int(folded.max(initial=0)).bit_length() // 8))
    planes = np.ascontiguousarray(folded, f"<i{size}").view(np.uint8).reshape(-1, size)[:, :width].T
    # noise has runs of equal bytes but few longer repetitions, so only runs are searched for
    deflate = zlib.compressobj(strategy=zlib.Z_RLE)
    data = b64encode(deflate.compress(planes.tobytes()) + deflate.flush()).decode("ascii")
    return {"shape": list(values.shape), "differences": differences, "bytes": width, "data": data}


def packed_faces(faces: NDArray[np.int32]) -> dict[str, Any]:
    """Pack triangles: the first corner minus that of the previous triangle, and the other corners minus the first."""
    first, second, third = faces.T
    return packed(np.stack([np.diff(first, prepend=np.int32(0)), second - first, third - first], axis=1))
