"""Pairs for training come from own meshes as they are denoised, or are generated and repeat."""

from pathlib import Path

import numpy as np
import pytest
from shapes import grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.api.training_pairs import training_pairs, write_pairs
from cascadenorm.data_gen import DatasetConfig
from cascadenorm.evaluation.harness import evaluate
from cascadenorm.io import OutputError
from cascadenorm.io.pairs import find_pairs
from cascadenorm.mesh import Mesh, in_frame, scaled_alike


def save(mesh: cn.Mesh, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cn.write(cn.from_arrays(mesh.vertices, mesh.faces), path)


def test_own_shapes_get_noise_again_and_again_and_own_pairs_are_taken_as_they_are(tmp_path):
    ball, rough = icosphere(3), noisy(icosphere(4), 0.2)
    save(ball, tmp_path / "shapes" / "ball.ply")
    save(rough, tmp_path / "pairs" / "ball" / "noisy.ply")
    save(icosphere(4), tmp_path / "pairs" / "ball" / "clean.ply")
    config = DatasetConfig(count=12, min_faces=1200, max_faces=1280, noise_kinds=("normal",), min_level=0.1)
    made = training_pairs([tmp_path / "shapes"], [tmp_path / "pairs"], config)
    shapes, pieces = made[:3], made[3:]
    assert len(pieces) == 4 and sum(len(p.clean.faces) for p in pieces) == len(rough.faces)
    for p in shapes:
        np.testing.assert_array_equal(p.clean.vertices, in_frame(ball)[0].vertices)
        spread = np.linalg.norm(p.noisy.vertices - p.clean.vertices, axis=1).std() / p.clean.mean_edge_length
        assert spread > 0.03 and p.family == "own"
    assert (shapes[0].noisy.vertices != shapes[1].noisy.vertices).any()
    corners = np.concatenate([p.noisy.corners for p in pieces]).reshape(-1, 9)
    expected = scaled_alike(rough, icosphere(4))[0].corners.reshape(-1, 9)
    np.testing.assert_array_equal(np.unique(corners, axis=0), np.unique(expected, axis=0))
    cn.write(cn.from_arrays(ball.vertices, ball.faces), tmp_path / "pairs" / "ball" / "noisy.ply", force=True)
    with pytest.raises(cn.MeshError, match="different faces"):
        training_pairs([], [tmp_path / "pairs"], config)
    (tmp_path / "empty").mkdir()
    with pytest.raises(cn.ReadError, match="holds no mesh files"):
        training_pairs([tmp_path / "empty"], [], config)


def test_polygons_of_own_pairs_are_cut_into_the_same_triangles(tmp_path):
    sheet = grid(20, 20)
    corners = np.arange(21 * 21).reshape(21, 21)
    quads = np.stack([corners[:-1, :-1], corners[:-1, 1:], corners[1:, 1:], corners[1:, :-1]], axis=-1).reshape(-1, 4)
    for name, mesh in (("clean", sheet), ("noisy", noisy(sheet, 0.4))):
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
        lines += [f"f {' '.join(map(str, quad))}" for quad in (quads + 1).tolist()]
        (tmp_path / f"{name}.obj").write_text("\n".join(lines))
    cut = [cn.read(tmp_path / f"{name}.obj").mesh.faces for name in ("noisy", "clean")]
    assert (cut[0] != cut[1]).any()
    (made,) = training_pairs([], [tmp_path], DatasetConfig(count=8))
    np.testing.assert_array_equal(made.noisy.faces, made.clean.faces)


def test_own_meshes_are_wound_as_they_are_to_be_denoised(tmp_path):
    ball, rough = icosphere(4), noisy(icosphere(4), 0.2)
    faces = ball.faces.copy()
    faces[::3] = faces[::3, ::-1]
    save(Mesh(ball.vertices, faces), tmp_path / "shapes" / "ball.ply")
    save(Mesh(rough.vertices, faces), tmp_path / "pairs" / "ball" / "noisy.ply")
    save(Mesh(ball.vertices, faces), tmp_path / "pairs" / "ball" / "clean.ply")
    config = DatasetConfig(count=8, min_faces=1200, max_faces=1280)
    made = training_pairs([tmp_path / "shapes"], [tmp_path / "pairs"], config)
    assert len(made) == 8
    for p in made:
        assert ((p.clean.face_normals * p.clean.centroids).sum(axis=1) > 0).all()
        np.testing.assert_array_equal(p.noisy.faces, p.clean.faces)


def test_generated_pairs_can_be_evaluated_and_repeat(tmp_path):
    for name in ("one", "two"):
        write_pairs(str(tmp_path / name), count=1, seed=3)
    (pair,), (again,) = find_pairs([tmp_path / "one"]), find_pairs([tmp_path / "two"])
    assert pair.noisy.read_bytes() == again.noisy.read_bytes()
    done = evaluate([tmp_path / "one"], methods=[])
    assert done.results[0].measures.normal_error_deg > 0
    with pytest.raises(OutputError, match="is not empty"):
        write_pairs(tmp_path / "one", count=1, seed=3)
    with pytest.raises(OutputError, match="is a file"):
        write_pairs(pair.noisy, count=1, seed=3)
    assert np.isfinite(done.means[0].measures.vertex_error_edges)
