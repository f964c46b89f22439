"""A mesh is inspected as its source stores it, and places are counted as the source counts."""

import io
from dataclasses import replace

import trimesh
from shapes import icosphere, noisy

from cascadenorm.api.inspection import Found, inspect
from cascadenorm.api.inspection.source import taken
from cascadenorm.io import from_arrays
from cascadenorm.io.interop import save_mesh

BALL = icosphere(2)
ROUGH = noisy(BALL, 0.2)


def test_a_file_with_other_positions_shares_the_connectivity():
    mesh = noisy(icosphere(2), 0.1)
    file = from_arrays(mesh.vertices, mesh.faces)
    moved = file.with_vertices(1.5 * file.mesh.vertices)
    before, after = (taken(one, None).mesh for one in (file, moved))
    assert before is not None and after is not None and before.topology is after.topology
    alone = inspect(moved.mesh.vertices, moved.mesh.faces)
    assert replace(inspect(moved), source=alone.source) == alone


OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nv 5 5 nan\nf 1 2 4 3\nf 1 2 9\nf 1 1 2\n"


def test_places_are_counted_as_the_file_counts():
    found = inspect(io.BytesIO(OBJ))
    assert (found.vertices, found.faces, found.counts_from) == (5, 4, 1)
    assert found.findings == {
        "bad_indices": Found(1, (2,)),
        "not_finite": Found(1, (5,)),
        "repeated_corners": Found(1, (3,)),
        "unreferenced": Found(1, (5,)),
    }


def test_copies_at_seams_are_joined_and_counted(tmp_path):
    save_mesh(tmp_path / "ball.stl", BALL)
    found = inspect(tmp_path / "ball.stl")
    assert (found.vertices, found.file_vertices, found.number_type) == (162, 960, "float32")
    assert found.closed and found.findings == {}


def test_every_kind_of_mesh_says_the_same(tmp_path):
    save_mesh(tmp_path / "rough.ply", ROUGH)
    own = inspect(ROUGH)
    for other in (
        inspect(ROUGH.vertices, ROUGH.faces),
        inspect(trimesh.Trimesh(ROUGH.vertices, ROUGH.faces, process=False)),
        inspect(tmp_path / "rough.ply"),
    ):
        assert {**vars(other), "source": own.source} == vars(own)


def test_a_polygon_counts_once(tmp_path):
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nv 3 0 0\nv 0 1 0\nf 1 2 3 4\nf 1 2 5\n")
    assert inspect(tmp_path / "flat.obj").zero_area == Found(1, (1,))
