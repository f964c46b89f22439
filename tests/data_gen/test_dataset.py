"""Data sets: reproducible pairs, no two alike, written where they should be."""

import json

import numpy as np
import pytest
from shapes import grid, icosphere
from small_datasets import SMALL

from cascadenorm.data_gen import SHAPE_FAMILIES, DatasetConfig, clean_mesh, own_pair, pair, write_dataset
from cascadenorm.data_gen.dataset import training_patches
from cascadenorm.mesh import part_of

QUICK = {**SMALL, "families": ("smooth", "bumpy", "polyhedron")}


def test_no_two_are_alike():
    config = DatasetConfig(seed=3, families=("polyhedron",), **SMALL)
    meshes = [clean_mesh(config, index) for index in range(8)]
    measures = {(len(mesh.faces), round(mesh.area, 9), round(mesh.volume, 9)) for mesh in meshes}
    assert len(measures) == 8


def test_the_same_index_gives_the_same_bytes_whatever_was_made_before():
    config = DatasetConfig(seed=7, **QUICK)
    first = pair(config, 3)
    pair(config, 1)
    again = pair(config, 3)
    assert first.noisy.vertices.tobytes() == again.noisy.vertices.tobytes()
    assert first.clean.faces.tobytes() == again.clean.faces.tobytes()
    assert first.normals.tobytes() == again.normals.tobytes()
    assert first[3:] == again[3:]


def test_seeds_differ_and_noise_settings_leave_the_shapes_alone():
    config = DatasetConfig(seed=7, **QUICK)
    clean = clean_mesh(config, 2)
    other = clean_mesh(DatasetConfig(seed=8, **QUICK), 2)
    assert clean.vertices.shape != other.vertices.shape or not np.allclose(clean.vertices, other.vertices)
    quiet = DatasetConfig(seed=7, noise_kinds=("none",), **QUICK)
    assert clean_mesh(quiet, 2).vertices.tobytes() == clean.vertices.tobytes()
    assert pair(quiet, 2).noisy.vertices.tobytes() == clean.vertices.tobytes()
    assert pair(quiet, 2).level == 0


def test_relief_belongs_to_the_shape_and_most_of_it_has_no_noise():
    config = DatasetConfig(seed=7, relief=1.0, noise_kinds=("normal", "none"), **QUICK)
    plain = DatasetConfig(seed=7, noise_kinds=("none",), **QUICK)
    made = [pair(config, index) for index in range(12)]
    assert 3 <= sum(one.noise_kind == "none" for one in made) <= 11
    for index, one in enumerate(made):
        assert not np.allclose(one.clean.vertices, pair(plain, index).clean.vertices)
        assert (one.noise_kind == "none") == (one.noisy.vertices.tobytes() == one.clean.vertices.tobytes())


def test_without_the_noise_kind_none_all_meshes_have_noise():
    families = ("low_poly", "decimated", "structured")
    config = DatasetConfig(seed=3, relief=0.5, families=families, noise_kinds=("normal", "gaussian"), **SMALL)
    made = [pair(config, index) for index in range(12)]
    assert {one.family for one in made} == set(families)
    assert all(one.noise_kind != "none" and one.level >= config.min_level for one in made)
    assert all(not np.allclose(one.noisy.vertices, one.clean.vertices, rtol=0, atol=1e-4) for one in made)


@pytest.mark.parametrize("family", ["view", "segmentation", "cad_tessellation"])
def test_what_is_measured_or_tessellated_has_no_relief(family):
    settings = {"seed": 1, "families": (family,), "noise_kinds": ("none",), **SMALL}
    plain, other = (pair(DatasetConfig(relief=relief, **settings), 0) for relief in (0.0, 1.0))
    assert plain.clean.vertices.tobytes() == other.clean.vertices.tobytes()


def test_levels_are_log_uniform_within_their_bounds():
    config = DatasetConfig(seed=2, min_level=0.02, max_level=0.9, **QUICK)
    clean = clean_mesh(config, 0)
    logs = np.log([own_pair(config, index, clean).level for index in range(100)])
    low, high = np.log(0.02), np.log(0.9)
    assert low <= logs.min()
    assert logs.max() <= high
    assert logs.mean() == pytest.approx((low + high) / 2, abs=5 * (high - low) / np.sqrt(12 * 100))


def test_half_of_the_volumes_and_point_clouds_may_have_larger_errors():
    config = DatasetConfig(seed=2, families=("tomogram", "points"), min_level=0.4, max_level=0.4, **SMALL)
    levels = np.array([pair(config, index).level for index in range(12)])
    assert 2 <= np.count_nonzero(levels > 0.4 + 1e-9) <= 10
    assert levels.min() >= 0.4 - 1e-9 and 0.45 < levels.max() <= 0.6


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"count": 0}, "count is 0"),
        ({"seed": -1}, "seed is -1"),
        ({"families": ("teapot",)}, r"teapot.*statue"),
        ({"families": ()}, "empty"),
        ({"min_faces": 10}, "10 to"),
        ({"min_faces": 5000, "max_faces": 4000}, "5000 to 4000"),
        ({"noise_kinds": ("salt",)}, r"salt.*impulsive"),
        ({"relief": 1.5}, r"1\.5"),
        ({"noise_kinds": ()}, "empty"),
        ({"min_level": 0.0}, "0.0 to"),
        ({"min_level": 0.5, "max_level": 0.1}, r"0\.5 to 0\.1"),
    ],
)
def test_nonsense_is_refused_with_the_value_and_the_way_out(settings, message):
    with pytest.raises(ValueError, match=message):
        DatasetConfig(**settings)


def write_arrays(path, mesh):
    path.write_bytes(mesh.vertices.tobytes() + mesh.faces.tobytes())


def test_a_data_set_is_written_whole_and_reports_progress(tmp_path):
    config = DatasetConfig(count=3, seed=4, **QUICK)
    calls = []
    write_dataset(tmp_path / "set", config, write=write_arrays, progress=lambda *call: calls.append(call))
    assert calls == [("generating", 1, 3), ("generating", 2, 3), ("generating", 3, 3)]
    index = json.loads((tmp_path / "set" / "dataset.json").read_text())
    assert index["config"]["seed"] == 4
    for number, entry in enumerate(index["pairs"]):
        made = pair(config, number)
        assert entry["name"] == f"{number:05d}_{made.family}"
        assert entry["faces"] == len(made.clean.faces)
        written = (tmp_path / "set" / entry["name"] / "noisy.ply").read_bytes()
        assert written == made.noisy.vertices.tobytes() + made.noisy.faces.tobytes()
    with pytest.raises(ValueError, match="workers is 0"):
        write_dataset(tmp_path, config, write=write_arrays, workers=0)


@pytest.mark.slow
def test_processes_write_the_same_bytes(tmp_path):
    config = DatasetConfig(count=4, seed=4, **QUICK)
    for name, workers in (("one", 1), ("two", 2)):
        write_dataset(tmp_path / name, config, write=write_arrays, workers=workers)
    files = sorted(path.relative_to(tmp_path / "one") for path in (tmp_path / "one").rglob("*") if path.is_file())
    assert len(files) == 9
    for file in files:
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()


def test_patches_have_every_face_once_and_at_most_so_many():
    mesh = icosphere(4)
    found = training_patches(mesh, faces=700)
    assert max(map(len, found)) <= 700 < 2 * min(map(len, found))
    np.testing.assert_array_equal(np.sort(np.concatenate(found)), np.arange(len(mesh.faces)))


def test_a_small_mesh_is_one_patch():
    mesh = grid(3, 3)
    (only,) = training_patches(mesh, faces=len(mesh.faces))
    np.testing.assert_array_equal(part_of(mesh, only)[0].corners, mesh.corners)


def test_a_piece_has_the_faces_where_they_were_and_no_other_vertices():
    mesh = icosphere(3)
    for chosen in training_patches(mesh, faces=100):
        part, _ = part_of(mesh, chosen)
        np.testing.assert_array_equal(part.corners, mesh.corners[chosen])
        assert len(np.unique(part.faces)) == len(part.vertices) < len(mesh.vertices)


def test_a_strip_is_cut_across_its_length():
    mesh = grid(40, 2)
    longest = np.argmax(np.ptp(mesh.vertices, axis=0))
    (first, second) = training_patches(mesh, faces=len(mesh.faces) // 2)
    assert mesh.centroids[first, longest].max() <= mesh.centroids[second, longest].min()


def test_half_of_the_scans_have_the_error_of_cameras_and_the_others_another():
    config = DatasetConfig(seed=3, families=("fused",), min_faces=1200, max_faces=1800)
    made = [pair(config, index) for index in range(4)]
    assert {"sensor"} < {each.noise_kind for each in made}
    for each in made:
        assert SHAPE_FAMILIES[each.family].seen
        np.testing.assert_array_equal(each.noisy.faces, each.clean.faces)
        assert not np.array_equal(each.noisy.vertices, each.clean.vertices)
