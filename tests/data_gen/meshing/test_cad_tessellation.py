"""Parts as CAD kernels tessellate them: closed, within their tolerance, the same for the same seed."""

import numpy as np
import pytest

from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.data_gen.meshing.cad_tessellation import MAKERS, cad_part
from cascadenorm.data_gen.meshing.half_edges import is_manifold


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize("seed", range(3))
def test_parts_are_closed_and_converge_with_the_tolerance(make, seed):
    volumes = []
    for tolerance in (1e-2, 1e-3):
        try:
            mesh = make(tolerance, np.random.default_rng(seed))
        except UnfitShapeError:
            return
        assert (mesh.topology.edge_faces.counts == 2).all() and is_manifold(mesh)
        assert (mesh.topology.balance == 0).all(), "consistently oriented"
        volumes.append(mesh.volume)
    assert volumes[1] > 0 and volumes[0] == pytest.approx(volumes[1], rel=0.15)


def test_a_seed_and_a_number_of_faces_decide_a_part():
    def part() -> object:
        rng = np.random.default_rng(5)
        while True:
            try:
                return cad_part(faces=2000, rng=rng)
            except UnfitShapeError:
                continue

    first, again = part(), part()
    assert first.vertices.tobytes() == again.vertices.tobytes() and 1400 <= len(first.faces) <= 2800
    assert np.linalg.norm(first.vertices, axis=1).max() == pytest.approx(1, rel=0.01)
