"""Regions in meshes and files of their own: shared walls stay shared, and all is as in one mesh of walls."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from partitions import walls
from shapes import icosphere, noisy

import cascadenorm as cn
from cascadenorm.api.regions.regions import coincident_vertices, join_meshes
from cascadenorm.cli import run
from cascadenorm.errors import MeshError
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import Mesh

OPTIONS = {"method": "bilateral-normal", "iterations": 5}


def compact(mesh):
    """The mesh without vertices that no face uses, and the vertices that it keeps."""
    used, faces = np.unique(mesh.faces, return_inverse=True)
    return Mesh(mesh.vertices[used], faces.reshape(-1, 3)), used


@pytest.fixture(scope="module")
def halves():
    found = walls("half balls")
    (first, of_first), (second, of_second) = (compact(found.region(label)) for label in (1, 2))
    return found.mesh, first, second, of_first, of_second


def test_regions_move_as_their_walls_in_one_mesh(halves):
    mesh, first, second, of_first, of_second = halves
    expected = cn.denoise(mesh.vertices, mesh.faces, **OPTIONS)
    moved = cn.denoise_regions([first, second], **OPTIONS)
    # In another order of the vertices the update ends elsewhere by a part of an edge
    for mine, rows in zip(moved, (of_first, of_second), strict=True):
        assert np.abs(mine.vertices - expected[rows]).max() < 0.2 * mesh.mean_edge_length
    shared, in_first, in_second = np.intersect1d(of_first, of_second, return_indices=True)
    assert len(shared) > 100
    assert moved[0].vertices[in_first].tobytes() == moved[1].vertices[in_second].tobytes()
    assert (moved[0].vertices[in_first] != mesh.vertices[shared]).any()


def test_vertices_that_rounding_has_parted_meet(halves):
    _, first, second, of_first, of_second = halves
    rounded = (second.vertices.astype(np.float32) * np.float32(1 + 1e-7), second.faces)
    mine, theirs = cn.denoise_regions([(first.vertices, first.faces), rounded], **OPTIONS)
    assert mine.dtype == np.float64 and theirs.dtype == np.float32
    _, in_first, in_second = np.intersect1d(of_first, of_second, return_indices=True)
    moved = (theirs[in_second] != rounded[0][in_second]).any(axis=1)
    assert moved.sum() > 100
    assert (mine[in_first][moved] == theirs[in_second][moved]).all()


def test_meshes_that_share_nothing_are_denoised_alone(halves):
    _, first, *_ = halves
    other = noisy(icosphere(2), 0.2)
    apart = Mesh(other.vertices + 5, other.faces)
    together = cn.denoise_regions([first, apart], **OPTIONS)
    for one, mesh in zip(together, (first, apart), strict=True):
        assert one.vertices.tobytes() == cn.denoise(mesh, **OPTIONS).vertices.tobytes()


def test_the_kind_of_each_mesh_is_kept(halves):
    _, first, second, *_ = halves
    theirs = trimesh.Trimesh(first.vertices, first.faces, process=False)
    moved = cn.denoise_regions([theirs, (second.vertices.astype(np.float32), second.faces)], **OPTIONS)
    assert isinstance(moved[0], trimesh.Trimesh) and moved[1].dtype == np.float32
    assert (theirs.vertices == first.vertices).all()


def test_controls_over_the_vertices_of_one_mesh_are_refused(halves):
    _, first, second, *_ = halves
    with pytest.raises(cn.ParameterError, match="applies to a single mesh"):
        cn.denoise_regions([first, second], fixed=[0, 1])


@pytest.mark.parametrize("kind", [str, Path])
def test_paths_are_refused_with_the_function_for_files(kind):
    with pytest.raises(cn.ParameterError, match=r"left.ply is a path: for files call denoise_region_files"):
        cn.denoise_regions([kind("left.ply")])


def test_no_meshes_are_refused():
    for denoise in (cn.denoise_regions, cn.denoise_region_files):
        with pytest.raises(cn.MeshError, match="no meshes are given: give at least one"):
            denoise(iter(()))


def test_meshes_may_come_from_a_generator(halves):
    meshes = halves[1:3]
    listed, generated = (cn.denoise_regions(given, **OPTIONS) for given in (meshes, iter(meshes)))
    for one, other in zip(listed, generated, strict=True):
        np.testing.assert_array_equal(one.vertices, other.vertices)


def test_a_single_path_is_a_file(tmp_path):
    save_mesh(tmp_path / "a.ply", icosphere(1))
    (done,) = cn.denoise_region_files(tmp_path / "a.ply", method="laplacian")
    assert done.output == str(tmp_path / "a_denoised.ply")


def test_files_stay_joined(halves, tmp_path, capsys):
    _, first, second, of_first, of_second = halves
    names = [tmp_path / "a.ply", tmp_path / "b.ply"]
    for name, mesh in zip(names, (first, second), strict=True):
        cn.write(cn.from_arrays(mesh.vertices.astype(np.float32), mesh.faces), name)
    arguments = [*map(str, names), "-o", str(tmp_path / "out"), "--method", "bilateral-normal", "--set", "iterations=5"]
    assert run(["denoise-regions", *arguments, "--fixed", "0-9"]) == 0
    assert capsys.readouterr().out.count("bilateral-normal") == 2
    moved = [cn.read(tmp_path / "out" / name.name).mesh.vertices for name in names]
    _, in_first, in_second = np.intersect1d(of_first, of_second, return_indices=True)
    assert (moved[0][in_first] == moved[1][in_second]).all()
    for mine, mesh in zip(moved, (first, second), strict=True):
        assert (mine[:10] == mesh.vertices[:10].astype(np.float32)).all()
        assert (mine != mesh.vertices.astype(np.float32)).any()


@pytest.mark.parametrize(
    ("settings", "treatment"),
    [({}, "measured-surface"), ({"creases": 40}, "unknown"), ({"remove_detail": "4 edges"}, "unknown")],
)
def test_files_say_what_they_are_treated_as(halves, tmp_path, settings, treatment):
    names = [tmp_path / "a.ply", tmp_path / "b.ply"]
    for name, mesh in zip(names, halves[1:3], strict=True):
        save_mesh(name, mesh)
    done = cn.denoise_region_files(names, **settings)
    assert [one.treated_as.treatment for one in done] == [treatment] * 2


def test_files_go_beside_their_sources_and_are_not_overwritten(halves, tmp_path):
    _, first, second, *_ = halves
    names = [tmp_path / "a.obj", tmp_path / "b.ply"]
    for name, mesh in zip(names, (first, second), strict=True):
        cn.write(cn.from_arrays(mesh.vertices, mesh.faces), name)
    reports = cn.denoise_region_files(names, method="mean-normal", parameters={"iterations": 1})
    assert [report.output for report in reports] == [str(tmp_path / "a_denoised.obj"), str(tmp_path / "b_denoised.ply")]
    with pytest.raises(cn.OutputError):
        cn.denoise_region_files(names, method="mean-normal")
    with pytest.raises(cn.OutputError, match=r"a\.obj is a file: give the name of a folder"):
        cn.denoise_region_files(names, names[0], method="mean-normal")


@pytest.mark.parametrize("fixed", [[10**6], [-1], [0.5], np.ones(3, bool)])
def test_vertices_that_a_region_does_not_have_are_refused(halves, tmp_path, fixed):
    names = [tmp_path / "a.ply", tmp_path / "b.ply"]
    for name, mesh in zip(names, halves[1:3], strict=True):
        save_mesh(name, mesh)
    with pytest.raises(cn.ParameterError, match=r"fixed (references vertex|has shape)"):
        cn.denoise_region_files(names, method="laplacian", fixed=fixed)


def test_a_mask_that_fits_no_region_but_all_together_is_refused(halves, tmp_path):
    names = [tmp_path / "a.ply", tmp_path / "b.ply"]
    vertices = np.append(halves[1].vertices, [(0, 0, 0), (0, 0, 0)], axis=0)  # with two that no face references
    for name, mesh in zip(names, (Mesh(vertices, halves[1].faces), halves[1]), strict=True):
        save_mesh(name, mesh)
    with pytest.raises(cn.ParameterError, match=r"mask has shape"):
        cn.denoise_region_files(names, method="laplacian", mask=np.ones(len(vertices) - 1))


def test_coincident_vertices_of_one_mesh_stay_two():
    twice = Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 0), (0, -1, 0)], [(0, 1, 2), (3, 4, 1)])
    far = Mesh([(5, 0, 0), (6, 0, 0), (5, 1, 0)], [(0, 1, 2)])
    first, groups = coincident_vertices([twice, far])
    np.testing.assert_array_equal(first, np.arange(8))
    assert groups[0] != groups[1]


def test_joined_meshes_share_the_vertices_that_coincide():
    one = Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    other = Mesh([(1, 0, 0), (0, 0, 1e-9), (0, -1, 0)], [(0, 1, 2)])
    first, groups = coincident_vertices([one, other])
    np.testing.assert_array_equal(first, [0, 1, 2, 1, 0, 5])
    assert groups[0] == groups[1]
    whole, vertices = join_meshes([one, other], first)
    np.testing.assert_array_equal(whole.faces, [(0, 1, 2), (1, 0, 3)])
    np.testing.assert_array_equal(whole.vertices[vertices[:3]], one.vertices)


@pytest.mark.parametrize("kind", ["arrays", "trimesh"])
def test_bad_vertices_and_faces_of_regions_are_isolated(halves, kind):
    _, first, second, *_ = halves
    whole = cn.denoise_regions([first, second], **OPTIONS)
    vertices = np.vstack([first.vertices, (np.nan, 0, 0)])
    faces = np.vstack([first.faces, (0, 1, len(vertices) - 1)])
    bad = (vertices, faces) if kind == "arrays" else trimesh.Trimesh(vertices, faces, process=False)
    with pytest.raises(MeshError, match="on_bad"):
        cn.denoise_regions([bad, second], **OPTIONS)
    mine, theirs = cn.denoise_regions([bad, second], on_bad="isolate", **OPTIONS)
    mine = mine if kind == "arrays" else mine.vertices
    np.testing.assert_array_equal(mine[:-1], whole[0].vertices)
    np.testing.assert_array_equal(mine[-1], (np.nan, 0, 0))
    np.testing.assert_array_equal(theirs.vertices, whole[1].vertices)


def test_two_files_of_one_output_are_refused_before_anything_is_written(tmp_path):
    paths = [tmp_path / side / "a.ply" for side in ("left", "right")]
    for path in paths:
        path.parent.mkdir()
        save_mesh(path, noisy(icosphere(1), 0.1))
    for force in (False, True):
        with pytest.raises(
            cn.OutputError, match=r"left.a\.ply and .*right.a\.ply would both be written to .*out.a\.ply"
        ):
            cn.denoise_region_files(paths, tmp_path / "out", method="laplacian", force=force)
        with pytest.raises(cn.OutputError, match=r"a\.ply is given twice"):
            cn.denoise_region_files([paths[0], str(paths[0])], method="laplacian", force=force)
    assert sorted(path for path in tmp_path.rglob("*") if path.is_file()) == sorted(paths)
    assert not (tmp_path / "out").exists()


def test_regions_that_cannot_be_denoised_leave_no_folder(tmp_path):
    (tmp_path / "bad.ply").write_bytes(b"ply")
    (tmp_path / "kept").mkdir()
    for name in ("kept", "new/inner"):
        with pytest.raises(cn.ReadError):
            cn.denoise_region_files(tmp_path / "bad.ply", tmp_path / name)
    assert {path.name for path in tmp_path.iterdir()} == {"bad.ply", "kept"}
