"""Files larger than memory: the bytes that they have in memory."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from shapes import grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.geometry.neighborhoods import steps_from
from cascadenorm.interop import save_mesh
from cascadenorm.io.content import Content
from cascadenorm.io.ply import PlyFile
from cascadenorm.io.polygons import Polygons
from cascadenorm.mesh import Mesh
from cascadenorm.streaming import ply_rows, streaming
from cascadenorm.streaming.tiles import cuts_of

BALL = noisy(icosphere(4), 0.2)
SHEET = noisy(grid(60, 40), 0.15, seed=3)
SETTINGS = {"method": "taubin", "parameters": {"iterations": 3}}


@pytest.fixture
def place(tmp_path, monkeypatch) -> Path:
    """A working directory, in which files of some thousand faces are large."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(streaming, "SMALLEST", 300)
    monkeypatch.setattr(ply_rows, "BLOCK", 1000)
    return tmp_path


def with_colors(mesh, kind) -> bytes:
    """A PLY file with further properties of vertices and faces."""
    polygons = Polygons.from_rows(mesh.faces.astype(np.int64))
    rng = np.random.default_rng(0)
    values = {"quality": rng.random(len(mesh.vertices)).astype(np.float32)}
    labels = {"label": rng.integers(0, 9, len(mesh.faces)).astype(np.int32)}
    return PlyFile.encode(Content(mesh.vertices.astype(kind), polygons, vertex_values=values, face_values=labels))[0]


@pytest.mark.parametrize("mesh", [BALL, SHEET], ids=["ball", "sheet"])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_patches_on_disk_give_the_bytes_of_the_file_in_memory(place, mesh, kind):
    mesh = Mesh(np.append(mesh.vertices * 5 + [300, 0, 0], [[1e4, 0, 0]], axis=0), mesh.faces)  # and an unused vertex
    Path("scan.ply").write_bytes(with_colors(mesh, kind))
    expected = cn.denoise_file("scan.ply", "whole.ply", **SETTINGS, strength=0.8, max_displacement="0.2 edges")
    done = cn.denoise_large_file(
        "scan.ply", "parts.ply", memory=1, **SETTINGS, strength=0.8, max_displacement="0.2 edges"
    )
    assert Path("parts.ply").read_bytes() == Path("whole.ply").read_bytes()
    assert (done.moved, done.faces, done.controls) == (expected.moved, expected.faces, expected.controls)
    assert done.mean_displacement == pytest.approx(expected.mean_displacement, rel=1e-12)
    assert done.largest_displacement == pytest.approx(expected.largest_displacement, rel=1e-12)
    assert sorted(os.listdir()) == ["parts.ply", "scan.ply", "whole.ply"]


def test_laplacian_flow_and_the_command_line(place, capsys):
    save_mesh(place / "scan.ply", SHEET)
    words = ["denoise", "scan.ply", "--method", "laplacian", "--set", "order=2", "--set", "step=0.3"]
    assert run([*words, "-o", "whole.ply"]) == 0
    assert run([*words, "-o", "parts.ply", "--memory", "1 MB", "--json"]) == 0
    done = json.loads(capsys.readouterr().out.partition("\n{")[2].join(["{", ""]))
    assert done["output"] == "parts.ply" and done["moved"] == len(SHEET.vertices)
    assert (place / "parts.ply").read_bytes() == (place / "whole.ply").read_bytes()


def test_an_interrupted_run_goes_on_with_the_next_patch(place):
    save_mesh(place / "scan.ply", BALL)
    seen = []

    def interrupted(fraction):
        seen.append(fraction)
        if len(seen) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cn.denoise_large_file("scan.ply", "out.ply", memory=1, **SETTINGS, progress=interrupted)
    folder = place / ".out.ply.parts"
    kept = {path.name: path.stat().st_mtime_ns for path in folder.glob("patch_*.bin")}
    assert len(kept) == 3 and not (place / "out.ply").exists()
    before = []

    def noted(fraction):
        before.append({name: (folder / name).stat().st_mtime_ns for name in kept})

    cn.denoise_large_file("scan.ply", "out.ply", memory=1, **SETTINGS, progress=noted)
    assert before and all(found == kept for found in before)
    cn.denoise_file("scan.ply", "whole.ply", **SETTINGS)
    assert (place / "out.ply").read_bytes() == (place / "whole.ply").read_bytes() and not folder.exists()


def test_other_settings_begin_anew(place):
    save_mesh(place / "scan.ply", BALL)

    def interrupted(fraction):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cn.denoise_large_file("scan.ply", "out.ply", memory=1, **SETTINGS, progress=interrupted)
    other = {"method": "taubin", "parameters": {"iterations": 2}}
    cn.denoise_large_file("scan.ply", "out.ply", memory=1, **other)
    cn.denoise_file("scan.ply", "whole.ply", **other)
    assert (place / "out.ply").read_bytes() == (place / "whole.ply").read_bytes()


KILLED = """
from cascadenorm.streaming import streaming
streaming.SMALLEST = 300
def tell(fraction):
    print(fraction, flush=True)
given = {"method": "taubin", "parameters": {"iterations": 3}}
streaming.denoise_large_file("scan.ply", "out.ply", memory=1, progress=tell, **given)
"""


def test_a_killed_run_goes_on(place):
    save_mesh(place / "scan.ply", noisy(icosphere(5), 0.2))
    with subprocess.Popen([sys.executable, "-c", KILLED], stdout=subprocess.PIPE, text=True) as process:
        for _ in range(3):
            assert process.stdout.readline()
        process.send_signal(signal.SIGKILL)
    done = len(list((place / ".out.ply.parts").glob("patch_*.bin")))
    assert done >= 3 and not (place / "out.ply").exists()
    cn.denoise_large_file("scan.ply", "out.ply", memory=1, **SETTINGS)
    cn.denoise_file("scan.ply", "whole.ply", **SETTINGS)
    assert (place / "out.ply").read_bytes() == (place / "whole.ply").read_bytes()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: data[:-7], "it is truncated"),
        (lambda data: data.replace(b"binary_little_endian", b"ascii"), "only binary PLY can be read in parts"),
        (lambda data: data.replace(b"double x", b"int x   "), "not all float or all double"),
        (lambda data: data[:-12] + b"\xff" * 12, "face 5119 references a vertex that does not exist"),
        (lambda data: data[:-13] + b"\x04" + data[-12:], "face 5119 is not a triangle"),
        (lambda data: data[:-8] + data[-12:-8] + data[-4:], "face 5119 repeats a vertex"),
    ],
)
def test_files_that_are_no_such_tables_are_refused(place, change, message):
    data = b"".join(cn.from_arrays(BALL.vertices, BALL.faces).pieces())
    Path("scan.ply").write_bytes(change(data))
    with pytest.raises(cn.ReadError, match=message):
        cn.denoise_large_file("scan.ply", "out.ply", memory="1GB", **SETTINGS)
    assert not Path("out.ply").exists()


def test_vertices_that_are_not_finite_or_split_are_refused(place):
    bad = BALL.vertices.copy()
    bad[1234] = np.nan
    data = b"".join(cn.from_arrays(BALL.vertices, BALL.faces).pieces())
    Path("bad.ply").write_bytes(data.replace(BALL.vertices[1234].tobytes(), bad[1234].tobytes()))
    with pytest.raises(cn.ReadError, match="vertex 1234 is not finite"):
        cn.denoise_large_file("bad.ply", "out.ply", memory="1GB", **SETTINGS)
    corners = BALL.vertices[BALL.faces].reshape(-1, 3)  # as STL files have them
    Path("split.ply").write_bytes(b"".join(cn.from_arrays(corners, np.arange(len(corners)).reshape(-1, 3)).pieces()))
    with pytest.raises(cn.ReadError, match="duplicated along seams"):
        cn.denoise_large_file("split.ply", "out.ply", memory="1GB", **SETTINGS)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--method", "auto"], "auto depends on the whole mesh"),
        (["--method", "bilateral-normal"], "bilateral-normal has a vertex update"),
        (["--method", "taubin", "--fixed", "0"], "--fixed needs the whole mesh in memory"),
        (["--method", "taubin", "--keep-volume"], "--keep-volume depends on the whole mesh"),
        (["--method", "taubin", "--strength", "2"], "--strength is 2; it must be at most 1 in a patch"),
        (["--method", "taubin", "--report", "r.html"], "--memory works on files only: leave out -"),
    ],
)
def test_what_sees_all_of_the_mesh_is_refused(place, capsys, words, message):
    save_mesh(place / "scan.ply", BALL)
    assert run(["denoise", "scan.ply", "-o", "out.ply", "--memory", "1GB", *words]) == 2
    assert message in capsys.readouterr().err
    assert sorted(os.listdir()) == ["scan.ply"]


def test_steps_are_counted_over_edges():
    mesh = grid(6, 5)
    seeds = np.zeros(len(mesh.vertices), bool)
    seeds[[0, 41]] = True
    steps = steps_from(mesh.topology, seeds, 4)
    reached = seeds.copy()
    for ring in range(5):
        assert ((steps <= ring) == reached).all()
        reached[mesh.faces[reached[mesh.faces].any(axis=1)]] = True
    assert steps.max() == 5


def test_tiles_have_about_equally_many_points():
    points = np.random.default_rng(0).normal(size=(4096, 3))
    cuts = cuts_of(points, 5)
    counts = np.bincount(cuts.tile(points), minlength=32)
    assert counts.min() >= 127 and counts.max() <= 129
