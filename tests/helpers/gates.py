"""Gates of a single decision."""

import numpy as np

from cascadenorm.detection.gate import Gate
from cascadenorm.detection.triangulation import FIGURES


def gate_above(figure: int, limit: float) -> Gate:
    """Return a gate that takes surfaces with a larger value of a feature for measured ones."""
    return Gate(
        roots=np.array([0], np.int32),
        figures=np.array([figure, -1, -1], np.int8),
        values=np.array([limit, 0.1, 0.9], np.float32),
        upper=np.array([2, 0, 0], np.int32),
    )


OPEN_SIDES = FIGURES.index("open sides")
OPEN = gate_above(OPEN_SIDES, 0.0)
"""A gate that takes open surfaces for measured ones."""
