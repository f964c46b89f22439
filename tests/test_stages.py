"""Methods in stages, in patches on disk: the answer that they give in memory."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from shapes import ball_of_voxels, cube, cubes, grid, icosphere, noisy, torus
from test_streaming import INWARD, flipped, shuffled, side_by_side, strip

import cascadenorm as cn
from cascadenorm.api.halo import Halo
from cascadenorm.cli import run
from cascadenorm.detection import chords, voxel_lattice
from cascadenorm.detection.parts import InMemory, median, nth
from cascadenorm.detection.segmentation_steps import has_voxel_faces, is_segmentation
from cascadenorm.detection.voxel_lattice import lattice_share
from cascadenorm.geometry.foldovers import foldovers, without_flips
from cascadenorm.geometry.orientation import oriented
from cascadenorm.io.content import Content
from cascadenorm.io.interop import save_mesh
from cascadenorm.io.stl import StlFile
from cascadenorm.learned.safeguards import what_is_bounded
from cascadenorm.mesh import Mesh
from cascadenorm.mesh.polygons import Polygons
from cascadenorm.streaming import fitting, ply_rows, stages, streaming
from cascadenorm.streaming.passes import Passes
from cascadenorm.streaming.ply_rows import ply_tables
from cascadenorm.streaming.store import Store

AGREES = 1e-6  # of an edge

RIBBON = noisy(grid(500, 6), 0.25, seed=1)
"""Much longer than a halo is wide, so that patches are parts of it."""


def ribbon_with_fin() -> Mesh:
    """A ribbon of which some edges have three faces."""
    middle = np.flatnonzero(grid(500, 6).vertices[:, 0] == 3)[100:300]
    tips = len(RIBBON.vertices) + np.arange(len(middle))
    fin = np.concatenate([
        np.stack([middle[:-1], middle[1:], tips[:-1]], axis=1), np.stack([middle[1:], tips[1:], tips[:-1]], axis=1)
    ])  # fmt: skip
    size = RIBBON.mean_edge_length
    return Mesh(
        np.concatenate([RIBBON.vertices, RIBBON.vertices[middle] + [0, 0, size]]), np.concatenate([RIBBON.faces, fin])
    )


def many() -> Mesh:
    """Components of many kinds: open, closed, flipped, computed, of one face; and a vertex without a face."""
    box, face = cube(6), Mesh([[0, 0, 9], [1, 0, 9], [0, 1, 9.5]], [[0, 1, 2]])
    mesh = flipped(side_by_side(RIBBON, INWARD, noisy(icosphere(2), 0.2), box, face))
    return Mesh(np.append(mesh.vertices * 3 + [70, 0, 0], [[500.0, 0, 0]], axis=0), mesh.faces)


SHAPES = {
    "ribbon": lambda: RIBBON,
    "rough": lambda: noisy(grid(500, 6), 0.7, seed=2),
    "non-manifold": ribbon_with_fin,
    "many": many,
    "shuffled": lambda: shuffled(noisy(grid(700, 7), 0.25, seed=1)),
}


@pytest.fixture
def place(tmp_path, monkeypatch) -> Path:
    """A working directory, in which files of some thousand faces are large."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(streaming, "SMALLEST", 1200)
    monkeypatch.setattr(ply_rows, "BLOCK", 1000)
    return tmp_path


def difference(ours: str, theirs: str) -> float:
    """Largest distance of vertices of two files, in mean edges."""
    one, other = cn.read(ours).mesh, cn.read(theirs).mesh
    assert (one.faces == other.faces).all()
    return np.abs(one.vertices - other.vertices).max() / one.mean_edge_length


def patch_sizes(monkeypatch) -> list[int]:
    """The numbers of vertices of the patches that are read from now on."""
    sizes, before = [], Store.patch

    def patch(store, number, rings):
        found = before(store, number, rings)
        sizes.append(len(found.patch.vertices))
        return found

    monkeypatch.setattr(Store, "patch", patch)
    return sizes


@pytest.mark.parametrize("name", SHAPES)
def test_auto_in_patches_agrees_with_memory(place, name, monkeypatch):
    mesh = SHAPES[name]()
    save_mesh("scan.ply", mesh)
    expected = cn.denoise_file("scan.ply", "whole.ply", method="auto", strength=0.9)
    sizes = patch_sizes(monkeypatch)
    done = cn.denoise_large_file("scan.ply", "parts.ply", memory=1, method="auto", strength=0.9)
    assert difference("parts.ply", "whole.ply") < AGREES
    assert max(sizes) < 0.8 * len(mesh.vertices)
    assert done.mean_displacement == pytest.approx(expected.mean_displacement, rel=1e-6)
    assert done.moved == expected.moved
    assert sorted(os.listdir()) == ["parts.ply", "scan.ply", "whole.ply"]


def test_computed_components_keep_their_bits(place):
    mesh = many()
    save_mesh("scan.ply", mesh)
    cn.denoise_large_file("scan.ply", "parts.ply", memory=1, method="auto")
    moved = cn.read("parts.ply").mesh.vertices
    component = mesh.topology.components
    for kept in (mesh.faces[-2, 0], len(mesh.vertices) - 1):  # of the box, and that without a face
        assert (moved[component == component[kept]] == mesh.vertices[component == component[kept]]).all()
    assert (moved[: len(RIBBON.vertices)] != mesh.vertices[: len(RIBBON.vertices)]).any(axis=1).mean() > 0.99


def test_cascade_in_patches_agrees_with_memory(place):
    save_mesh("scan.ply", RIBBON)
    cn.denoise_file("scan.ply", "whole.ply", method="cascade")
    cn.denoise_large_file("scan.ply", "parts.ply", memory=1, method="cascade")
    assert difference("parts.ply", "whole.ply") < AGREES


def test_a_halo_that_filters_by_distance_leave_is_widened(place, monkeypatch):
    """Tiny faces, of which many lie within the distance."""
    x, y, z = RIBBON.vertices.T
    fine = np.stack([x, np.where(y > 250, 250 + 0.1 * (y - 250), y), z], axis=1)
    monkeypatch.setattr(stages, "BY_DISTANCE", 4)
    save_mesh("scan.ply", Mesh(fine, RIBBON.faces))
    cn.denoise_file("scan.ply", "whole.ply", method="cascade")
    cn.denoise_large_file("scan.ply", "parts.ply", memory=1, method="cascade")
    assert difference("parts.ply", "whole.ply") < AGREES


def test_stl_by_the_default_of_the_command_line_where_it_does_not_fit(place, capsys, monkeypatch):
    content = Content(RIBBON.vertices, Polygons.from_rows(RIBBON.faces.astype(np.int64)))
    Path("scan.stl").write_bytes(b"".join(StlFile.encode(content)[0]))
    assert run(["denoise", "scan.stl", "-o", "whole.stl"]) == 0
    capsys.readouterr()
    monkeypatch.setattr(fitting, "free_memory", lambda: 1_000_000)
    assert run(["denoise", "scan.stl", "-o", "parts.stl"]) == 0
    said = capsys.readouterr().err
    assert "auto needs about" in said and "it is denoised in patches" in said and len(said.splitlines()) == 1
    assert difference("parts.stl", "whole.stl") < AGREES


def test_voxel_faces_are_told_from_all_patches(place):
    mesh = cubes(ball_of_voxels(9.0))
    assert has_voxel_faces(mesh)
    save_mesh("scan.ply", mesh)
    cn.denoise_file("scan.ply", "whole.ply", method="auto")
    cn.denoise_large_file("scan.ply", "parts.ply", memory=1, method="auto")
    assert difference("parts.ply", "whole.ply") < AGREES


KINDS = {
    "many": many,
    "voxels": lambda: cubes(ball_of_voxels(9.0)),
    "rough": lambda: noisy(icosphere(4), 1.0),
    "torus": lambda: torus(60, 24),
    "sheet": lambda: grid(40, 30),
}


@pytest.mark.parametrize("name", KINDS)
def test_what_is_told_from_the_patches_is_what_the_whole_tells(place, name, monkeypatch):
    mesh = KINDS[name]()
    save_mesh("scan.ply", mesh)
    Path("store").mkdir()
    store = Store(ply_tables(Path("scan.ply")), Path("store"))
    whole = store.gather(500, lambda groups: 300)
    assert whole.patches > 1
    seen = whole.frame.of(mesh)
    passes = Passes(store, Path("store"), map, None, 1.0)
    expected = what_is_bounded_in_memory(seen)
    monkeypatch.setattr(chords, "AT_ONCE", 100)  # numbers of few are held in memory
    monkeypatch.setattr(voxel_lattice, "AT_ONCE", 100)
    found = what_is_bounded(passes)
    assert sorted(zip(found.exact, found.untold, strict=True)) == expected[0]
    assert found.voxel_faces == expected[1]
    assert is_segmentation(passes) == expected[2]
    assert lattice_share(passes) == pytest.approx(expected[3], abs=1e-12)
    assert whole.median_edge_length == pytest.approx(seen.median_edge_length, rel=1e-14)
    assert whole.diagonal == pytest.approx(seen.diagonal, rel=1e-14)


def what_is_bounded_in_memory(mesh: Mesh):
    mesh = oriented(mesh)
    bounded = what_is_bounded(InMemory(mesh))
    used = np.unique(mesh.topology.face_components)
    each = sorted(zip(bounded.exact[used], bounded.untold[used], strict=True))
    return each, bounded.voxel_faces, is_segmentation(mesh), lattice_share(mesh)


def test_flips_are_taken_back_in_patches_as_in_the_whole(place, monkeypatch):
    """A displacement so large that halvings go on over several passes of a few each."""
    save_mesh("scan.ply", RIBBON)
    Path("store").mkdir()
    store = Store(ply_tables(Path("scan.ply")), Path("store"))
    store.gather(500, lambda groups: 300)
    passes, wanted = Passes(store, Path("store"), map, None, 1.0), store.vertex_layer("wanted", np.dtype(("f8", (3,))))
    seen = store.whole.frame.of(RIBBON)
    moved = seen.vertices + 3 * seen.mean_edge_length * np.random.default_rng(0).normal(size=seen.vertices.shape)
    passes.run("moved", 1, lambda view: view.keep_vertices(wanted, moved[view.patch.vertices]))
    monkeypatch.setattr(stages, "HALVINGS_AT_ONCE", 3)
    halvings = stages._halvings(passes, wanted)
    out = np.empty_like(moved)

    def collect(view):
        place = stages.partly_displaced(view.mesh, view.of_vertices(wanted), view.of_vertices(halvings))
        out[view.patch.inside] = place[~view.patch.halo.vertices]

    passes.run("collected", 1, collect)
    assert (out == without_flips(seen, moved)).all()
    assert (out != moved).any() and foldovers(seen).sum() < len(seen.faces)
    assert (place / "store" / "halvings_1_0.npz").exists()


KILLED = """
import sys
from cascadenorm.streaming import streaming
streaming.SMALLEST = 1200
def tell(fraction):
    print(fraction, flush=True)
streaming.denoise_large_file("scan.ply", "out.ply", memory=1, method="auto", progress=tell)
"""


def test_a_killed_run_goes_on_with_the_next_patch_of_its_pass(place):
    save_mesh("scan.ply", RIBBON)
    cn.denoise_large_file("scan.ply", "expected.ply", memory=1, method="auto")
    for lines in (2, 9):  # in the first pass, and in a later one
        with subprocess.Popen([sys.executable, "-c", KILLED], stdout=subprocess.PIPE, text=True) as process:
            for _ in range(lines):
                assert process.stdout.readline()
            process.send_signal(signal.SIGKILL)
        folder = place / ".out.ply.parts"
        kept = {path.name: path.stat().st_mtime_ns for path in folder.glob("stage_*.npz")}
        assert kept and not (place / "out.ply").exists()
    seen, fractions = {}, []

    def noted(fraction):
        fractions.append(fraction)
        seen.update({name: (folder / name).stat().st_mtime_ns for name in kept if folder.exists()})

    cn.denoise_large_file("scan.ply", "out.ply", memory=1, method="auto", progress=noted)
    assert seen == kept  # none of them was done again
    assert (place / "out.ply").read_bytes() == (place / "expected.ply").read_bytes() and not folder.exists()
    assert fractions == sorted(fractions) and fractions[-1] == 1.0 and len(set(fractions)) > 20


def test_surfaces_with_a_single_side_are_refused(place):
    save_mesh("scan.ply", side_by_side(RIBBON, strip()))
    with pytest.raises(cn.MeshError, match=r"scan\.ply: a part of the surface cannot be oriented"):
        cn.denoise_large_file("scan.ply", "parts.ply", memory=1, method="auto")
    assert os.listdir() == ["scan.ply"]


def test_patches_of_arrays_do_not_take_methods_in_stages():
    whole = cn.Whole.of(RIBBON.vertices, RIBBON.faces)
    patch = whole.patch(RIBBON.faces, RIBBON.vertices[:, 0] > 0.9, 2)
    assert isinstance(patch.halo, Halo)
    with pytest.raises(cn.ParameterError, match="auto depends on the whole mesh"):
        cn.denoise(RIBBON.vertices[patch.vertices], patch.faces, method="auto", halo=patch.halo)


@pytest.mark.parametrize("count", [1, 2, 5, 1000])
def test_numbers_in_blocks_are_selected_as_in_memory(count):
    values = np.random.default_rng(count).choice(10.0 ** np.linspace(-200, 200, 400), count)

    def blocks():
        return (values[i : i + 300] for i in range(0, count, 300))

    assert [nth(blocks, place) for place in range(0, count, 7)] == np.sort(values)[::7].tolist()
    assert median(blocks, count) == np.median(values)
    assert median(lambda: iter([np.zeros(3), values + 1]), count, 3) == np.median(values + 1)
