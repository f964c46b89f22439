"""Meshes of every family are sound, and closed where they claim to be."""

import numpy as np
import pytest
from small_datasets import SMALL

from cascadenorm.data_gen import SHAPE_FAMILIES, DatasetConfig, clean_mesh
from cascadenorm.data_gen.meshing.half_edges import is_manifold


@pytest.mark.parametrize("family", SHAPE_FAMILIES)
def test_meshes_of_every_family_are_sound(family):
    config = DatasetConfig(seed=1, families=(family,), **SMALL)
    mesh = clean_mesh(config, 0)
    assert is_manifold(mesh)
    assert 700 < len(mesh.faces) < 3000
    assert mesh.areas.min() > 0
    assert len(np.unique(mesh.faces)) == len(mesh.vertices)
    if SHAPE_FAMILIES[family].part not in ("piece", "view", "laser", "fused", "structured", "terrain", "modelled"):
        assert (mesh.topology.edge_faces.counts == 2).all()
        assert mesh.volume > 0
    # cameras all around may leave no hole, and a torus has none; a plane cuts some modelled meshes
    elif family not in ("fused", "structured", "modelled"):
        assert mesh.topology.boundary_vertices.any()


def test_low_poly_meshes_are_closed_and_keep_the_edges_of_a_box():
    made = SHAPE_FAMILIES["low_poly"].make(faces=2000, rng=np.random.default_rng(3))
    assert made.noisy is made.clean and made.clean.topology.edge_faces.counts.max() == 2
