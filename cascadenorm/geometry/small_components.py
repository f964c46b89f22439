"""Detection of small connected components, such as floaters of a reconstruction."""

import math
import re
from fractions import Fraction

import numpy as np

from cascadenorm.errors import ParameterError
from cascadenorm.mesh import Bools, Ints, Mesh

SMALL = "1%"  # fraction of the faces of the largest component below which a component counts as small


def component_limit(limit: str | int) -> tuple[Fraction, bool]:
    """Parse a limit, a number of faces or a percentage of those of the largest component, such as 50, "50" or "1%".

    Returns the number or fraction, and whether it is a fraction. Raises ParameterError if the limit is neither a whole
    number of at least 1 nor a percentage between 0 and 100.
    """
    found = re.fullmatch(r"\s*(\d{1,99}(?:\.\d{1,99})?)\s*(%?)\s*", str(limit))
    number = Fraction(found[1]) if found else Fraction(0)
    share = bool(found and found[2])
    if not number > 0 or (share and number > 100) or not (share or number.denominator == 1):
        raise ParameterError(
            f'is {limit!r}; it must be a number of faces such as 50, or a share of the largest component such as "1%"',
            parameter="drop_components",
        )
    return (number / 100 if share else number), share


def component_count(mesh: Mesh) -> int:
    """Return the number of connected components that have faces."""
    return int(np.count_nonzero(np.bincount(mesh.topology.face_components)))


def small_components(mesh: Mesh, limit: str | int = SMALL) -> tuple[Bools, Ints]:
    """Find the components with fewer faces than a limit (see `component_limit`), excluding the largest component.

    Faces that share a vertex are connected. Returns (m,) bool, whether each face lies in a small component; and the
    first face of each small component, ascending.
    """
    number, share = component_limit(limit)
    of_faces = mesh.topology.face_components
    counts = np.bincount(of_faces)
    largest = int(counts.max(initial=0))
    small = counts < min(math.ceil(number * largest if share else number), largest)
    inside = small[of_faces]
    first = np.unique(of_faces[inside], return_index=True)[1]
    return inside, np.sort(np.flatnonzero(inside)[first])
