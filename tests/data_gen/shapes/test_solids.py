"""No drawn polyhedron is one of the regular solids that serve as test models."""

import numpy as np

from cascadenorm.data_gen.shapes.solids import _regular


def test_no_drawn_polyhedron_is_regular():
    """All angles between the faces differ; in a regular solid few do, and regular solids serve as test models."""
    for seed in range(12):
        normals = _regular(np.random.default_rng(seed))
        angles = np.degrees(np.arccos((normals @ normals.T)[np.triu_indices(len(normals), 1)]))
        assert len(np.unique(angles.round(4))) > 0.95 * len(angles)
