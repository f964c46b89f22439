"""What computes the stages of a cascade: numpy and numba, or torch by the same formulas."""

from collections.abc import Callable
from typing import NamedTuple

from cascadenorm.baselines.vertex_update import recover_vertices
from cascadenorm.learned.descriptors import FILTERS, Filters, Stack
from cascadenorm.learned.regression import Regression
from cascadenorm.mesh import Mesh, Vectors


class Engine(NamedTuple):
    """What computes a stage: the processor, or a GPU by the same formulas."""

    filters: Filters
    regress: Callable[[Regression, Mesh, Stack], Vectors]
    recover: Callable[..., Vectors]


PROCESSOR = Engine(FILTERS, Regression.normals, recover_vertices)
