"""A gate that knows open surfaces alone."""

import numpy as np

from cascadenorm.detection.gate import Gate
from cascadenorm.detection.triangulation import FIGURES

OPEN_SIDES = FIGURES.index("open sides")
OPEN = Gate(
    roots=np.array([0], np.int32),
    figures=np.array([OPEN_SIDES, -1, -1], np.int32),
    limits=np.zeros(3, np.float32),
    children=np.array([(1, 2), (0, 0), (0, 0)], np.int32),
    shares=np.array([0, 0.1, 0.9], np.float32),
)
"""A gate that takes open surfaces for measured ones."""
