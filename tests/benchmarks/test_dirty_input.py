"""What docs/dirty-input.md says of us, input by input."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import cascadenorm as cn
from benchmarks.robustness.dirty_meshes import dirty_meshes
from cascadenorm.cli import run
from cascadenorm.io.content import Content
from cascadenorm.io.ply.ply import PlyFile
from cascadenorm.mesh.polygons import Polygons

ROOT = Path(__file__).parents[2]
MESHES = dirty_meshes()
SOUND = MESHES["sound"]
COUNT = len(SOUND.vertices)
EDGE = cn.Mesh(*SOUND[:2]).mean_edge_length
REFUSED = {
    "a vertex is not a number": r"1 of \d+ vertices are not finite \(vertices 7",
    "a vertex is infinite": r"1 of \d+ vertices are not finite \(vertices 7",
    "a face references a vertex past the last": r"1 face uses vertices that do not exist \(faces 576",
    "a face references vertex 1,000,000,000": r"1 face uses vertices that do not exist \(faces 576",
    "a face references vertex -1": r"1 face uses vertices that do not exist \(faces 576",
    "no vertices, no faces": "no faces",
    "points without faces": "no faces",
}
NEVER = ("no vertices, no faces", "points without faces")
DONE = [name for name in MESHES if name not in REFUSED]
METHODS = ["auto", "bilateral-normal"]
LEFT_BY_AUTO = ("a single triangle", "soup: no vertex is shared", "open", "a spike of 1e6")
"""Meshes on which `auto` finds no error: parts of a coarse torus with little noise, and faces without neighbours."""


@cache
def denoised(name: str, method: str) -> np.ndarray:
    return cn.denoise(*MESHES[name][:2], method=method)


def write(path: Path, name: str) -> None:
    """Write the arrays as they are, without a look at them."""
    mesh = MESHES[name]
    path.write_bytes(
        b"".join(PlyFile.encode(Content(mesh.vertices, Polygons.from_rows(mesh.faces.astype(np.int64))))[0])
    )


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", DONE)
def test_what_can_be_worked_on_comes_out_finite_and_near(name, method):
    mesh = MESHES[name]
    before, out = mesh.vertices.astype(float), denoised(name, method)
    assert out.shape == mesh.vertices.shape and out.dtype == mesh.vertices.dtype and np.isfinite(out).all()
    if "spike" in name:
        far = np.isin(np.arange(COUNT), mesh.faces[(mesh.faces == 7).any(axis=1)])
        before, out = before[~far], out[~far]
    if name not in LEFT_BY_AUTO:
        assert (out != before).any()
    assert (np.abs(out - before) <= 4 * EDGE * mesh.scale).all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", [name for name in DONE if MESHES[name].alike])
def test_what_does_not_matter_changes_nothing(name, method):
    mesh = MESHES[name]
    given = mesh.vertices[:COUNT].astype(float)
    at_origin = cn.Mesh((given - mesh.offset) / mesh.scale, SOUND.faces)
    expected = cn.denoise(at_origin, method=method).vertices - at_origin.vertices
    step = (denoised(name, method)[:COUNT].astype(float) - given) / mesh.scale
    rounding = float(np.spacing(np.abs(mesh.vertices[:COUNT]).max())) / mesh.scale
    np.testing.assert_allclose(step, expected, rtol=0, atol=1e-6 * EDGE + rounding)


@pytest.mark.parametrize("method", METHODS)
def test_flipped_faces_change_no_bit(method):
    for name in ("every third face flipped", "inside out"):
        assert denoised(name, method).tobytes() == denoised("sound", method).tobytes()


@pytest.mark.parametrize("method", METHODS)
def test_a_face_that_repeats_a_vertex_weighs_nothing_however_long_it_is(method):
    sound = cn.Mesh(*SOUND[:2])
    far = np.argmax(np.linalg.norm(sound.vertices - sound.vertices[0], axis=1))
    faces = np.vstack([sound.faces, [(0, 0, far), (1, 1, 1), (far, 2, 2)]])
    options = {"method": method, "max_displacement": "0.2 edges", "boundary": "smooth"}
    expected = cn.denoise(*SOUND[:2], **options)
    assert cn.denoise(sound.vertices, faces, **options).tobytes() == expected.tobytes()
    some = np.arange(len(faces)) > 100
    part = cn.denoise(sound.vertices, faces, only=some, method=method)
    assert part.tobytes() != sound.vertices.tobytes() and (part[[0, 1, 2]] == sound.vertices[[0, 1, 2]]).all()


def test_vertices_that_no_face_uses_keep_their_bits():
    mesh = MESHES["vertices without a face"]
    for method in METHODS:
        assert denoised("vertices without a face", method)[COUNT:].tobytes() == mesh.vertices[COUNT:].tobytes()


@pytest.mark.parametrize("method", METHODS)
def test_parts_do_not_see_each_other(method):
    two = MESHES["passes through itself"]
    out = denoised("passes through itself", method)
    alone = cn.denoise(two.vertices[:COUNT], two.faces[: len(SOUND.faces)], method=method)
    np.testing.assert_allclose(out[:COUNT], alone, rtol=0, atol=1e-6)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_worked_on_is_refused_with_the_place(name, method):
    with pytest.raises(cn.MeshError, match=REFUSED[name]):
        cn.denoise(*MESHES[name][:2], method=method)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", [name for name in REFUSED if name not in NEVER])
def test_isolated_it_does_no_harm_to_the_rest(name, method):
    mesh = MESHES[name]
    out = cn.denoise(*mesh[:2], method=method, on_bad="isolate")
    bad = ~np.isfinite(mesh.vertices).all(axis=1)
    assert out[bad].tobytes() == mesh.vertices[bad].tobytes()
    assert np.isfinite(out[~bad]).all()
    if not bad.any():
        assert out.tobytes() == denoised("sound", method).tobytes()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", MESHES)
def test_files_fare_as_arrays_do(tmp_path, capsys, name, method):
    source, output = tmp_path / "in.ply", tmp_path / "out.ply"
    write(source, name)
    code = run(["denoise", str(source), "-o", str(output), "--method", method])
    err = capsys.readouterr().err
    if name in REFUSED:
        assert code == 4 and err.count("\n") == 1 and not output.exists()
    elif "soup" in name or "without area" in name:  # a file's copies in one place are joined
        assert code == 0 and np.isfinite(cn.read(output).positions).all()
    else:
        notes = "not joined with it: --weld", "the result has", "auto found no "
        assert code == 0 and all(any(note in line for note in notes) for line in err.splitlines())
        np.testing.assert_array_equal(cn.read(output).positions, denoised(name, method))
    assert run(["inspect", str(source)]) == 0
    capsys.readouterr()


def test_a_file_joins_the_corners_of_soup_and_denoises_it_as_a_surface(tmp_path):
    write(tmp_path / "in.ply", "soup: no vertex is shared")
    file = cn.read(tmp_path / "in.ply")
    out = cn.read(cn.denoise(tmp_path / "in.ply", method="bilateral-normal")).positions
    assert len(file.mesh.vertices) == COUNT
    np.testing.assert_array_equal(out, cn.denoise(file.mesh, method="bilateral-normal").vertices[file.welds])


FOUND = {
    "sound": set(),
    "a vertex is not a number": {"not_finite"},
    "a face references a vertex past the last": {"bad_indices"},
    "a face repeats a vertex": {"repeated_corners"},
    "slivers": {"slivers", "non_manifold_edges"},
    "every face twice": {"duplicate_faces", "non_manifold_edges"},
    "vertices without a face": {"unreferenced"},
    "edges with three faces": {"non_manifold_edges"},
    "components joined at a vertex": {"non_manifold_vertices"},
    "every third face flipped": {"flipped_edges"},
    "inside out": {"inside_out"},
    "passes through itself": {"crossing_faces"},
    "soup: no vertex is shared": {"duplicate_vertices"},
    "no vertices, no faces": set(),
    "points without faces": {"unreferenced"},
}


@pytest.mark.parametrize("name", FOUND)
def test_inspection_names_what_is_wrong(name):
    assert FOUND[name] <= set(cn.inspect(*MESHES[name][:2]).findings)
    assert name != "sound" or not cn.inspect(*MESHES[name][:2]).findings


def test_inspection_says_where_the_number_type_is_too_coarse():
    assert cn.inspect(*MESHES["metres at UTM coordinates, float32"][:2]).resolution > 0.5
    assert cn.inspect(*MESHES["millimetres at UTM coordinates, float64"][:2]).resolution < 1e-5


def test_the_table_has_a_row_for_every_input():
    for page in (ROOT / "docs" / "dirty-input.md", ROOT / "benchmarks" / "dirty_input.md"):
        lines = page.read_text(encoding="utf-8").splitlines()
        rows = [line.split("|")[1].strip() for line in lines if line.startswith("|")]
        assert [row for row in rows if row in MESHES] == list(MESHES)
