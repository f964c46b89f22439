"""Files larger than memory: the bytes that they have in memory."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from shapes import cube, grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.geometry.neighborhoods import steps_from
from cascadenorm.geometry.orientation import oriented
from cascadenorm.io.content import Content
from cascadenorm.io.interop import save_mesh
from cascadenorm.io.ply.ply import PlyFile
from cascadenorm.io.stl import RECORD, StlFile
from cascadenorm.mesh import Mesh, ordered_for_cache
from cascadenorm.mesh.polygons import Polygons
from cascadenorm.regions.shells import shells
from cascadenorm.streaming import fitting, numbering, ply_rows, streaming
from cascadenorm.streaming.ply_rows import ply_tables
from cascadenorm.streaming.reordering import quantile
from cascadenorm.streaming.store import Store
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
    return b"".join(
        PlyFile.encode(Content(mesh.vertices.astype(kind), polygons, vertex_values=values, face_values=labels))[0]
    )


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


NORMALS = {"method": "bilateral-normal", "parameters": {"iterations": 2, "sweeps": 1}}


def shuffled(mesh: Mesh) -> Mesh:
    """The same mesh in an order that is poor in memory."""
    rng = np.random.default_rng(0)
    numbers = rng.permutation(len(mesh.vertices))
    return Mesh(mesh.vertices[numbers], rng.permutation(np.argsort(numbers)[mesh.faces]))


def flipped(mesh: Mesh) -> Mesh:
    """The same mesh with every third face flipped."""
    faces = mesh.faces.copy()
    faces[::3] = faces[::3, ::-1]
    return Mesh(mesh.vertices, faces)


def side_by_side(*meshes: Mesh) -> Mesh:
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts[:-1], strict=True)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces))


INWARD = Mesh(0.2 * icosphere(2).vertices + [2, 0, 0], icosphere(2).faces[:, ::-1])
SHAPES = {
    "ball": BALL,
    "shuffled": shuffled(noisy(icosphere(5), 0.2)),
    "flipped": flipped(side_by_side(BALL, INWARD, SHEET)),
    "flipped and shuffled": shuffled(flipped(side_by_side(noisy(icosphere(5), 0.2), INWARD, SHEET))),
}


@pytest.mark.parametrize("name", SHAPES)
def test_filters_of_normals_give_the_bytes_of_the_file_in_memory(place, name):
    """Groups of the vertex update, orientation, mean edge length and order are those of the whole."""
    save_mesh(place / "scan.ply", SHAPES[name])
    cn.denoise_file("scan.ply", "whole.ply", **NORMALS)
    cn.denoise_large_file("scan.ply", "parts.ply", memory=1, **NORMALS)
    assert Path("parts.ply").read_bytes() == Path("whole.ply").read_bytes()


def store_of(path: Path, folder: Path, span: int, size: int) -> Store:
    folder.mkdir()
    store = Store(ply_tables(path), folder)
    store.gather(span, lambda groups: size)
    return store


def test_what_is_known_of_the_whole_is_what_is_known_in_memory(place, monkeypatch):
    monkeypatch.setattr(numbering, "LEAF", 128)
    mesh = SHAPES["flipped and shuffled"]
    save_mesh(place / "scan.ply", mesh)
    expected = cn.Whole.of(mesh.vertices, mesh.faces)
    store = store_of(place / "scan.ply", place / "store", 700, 500)
    assert store.whole.patches > 8
    assert (store.whole.mean_edge_length, store.whole.groups) == (expected.mean_edge_length, expected.groups)
    assert store.whole.frame.center.tolist() == expected.frame.center.tolist()
    order = ordered_for_cache(expected.frame.of(mesh))
    turned = oriented(order.mesh).faces
    assert store.numbers.tolist() == order.numbers.tolist()
    seen = []
    for number in range(store.whole.patches):
        patch = store.patch(number, 2).patch
        whole, mine = patch.halo.whole, order.numbers[patch.vertices]
        assert (whole.group == expected.group[mine]).all() and (whole.around == expected.around[mine]).all()
        faces = patch.vertices[patch.faces]
        faces[whole.flipped] = faces[whole.flipped, ::-1]
        assert {*map(tuple, faces.tolist())} <= {*map(tuple, turned.tolist())}
        seen += patch.inside.tolist()
    assert sorted(seen) == list(range(len(mesh.vertices)))


@pytest.mark.parametrize("count", [1, 7, 8, 100, 129, 1000, 12_345])
def test_numbers_on_disk_are_added_as_in_memory(tmp_path, monkeypatch, count):
    monkeypatch.setattr(numbering, "LEAF", 128)
    values = np.random.default_rng(count).random(count)
    values.tofile(tmp_path / "values.bin")
    assert numbering.summed(tmp_path / "values.bin") == values.sum()


@pytest.mark.parametrize("share", [0.001, 0.999, 0.4, 0.7])
@pytest.mark.parametrize("count", [1, 2, 5, 2000])
def test_quantiles_on_disk_are_those_in_memory(share, count):
    points = np.random.default_rng(0).normal(size=(count, 3))
    blocks = (points[i : i + 300] for i in range(0, count, 300))
    assert quantile(blocks, share, count).tolist() == np.quantile(points, share, axis=0).tolist()


def strip() -> Mesh:
    """A band of 200 squares whose ends are joined after half a turn: a Möbius strip."""
    around = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    half = np.stack([np.cos(around / 2) * np.cos(around), np.cos(around / 2) * np.sin(around), np.sin(around / 2)], 1)
    middle = 3 * np.stack([np.cos(around), np.sin(around), 0 * around], 1)
    a = 2 * np.arange(200)
    b = a + 2
    ends = np.stack([a, a + 1, b, b + 1], 1)
    ends[-1, 2:] = 1, 0
    faces = np.concatenate([ends[:, [0, 1, 2]], ends[:, [1, 3, 2]]])
    return Mesh(np.stack([middle - half, middle + half], 1).reshape(-1, 3), faces)


def test_surfaces_with_a_single_side_are_left_to_methods_without_normals(place):
    save_mesh(place / "scan.ply", side_by_side(BALL, strip()))
    with pytest.raises(cn.MeshError, match=r"scan\.ply: a part of the surface cannot be oriented"):
        cn.denoise_large_file("scan.ply", "parts.ply", memory=1, **NORMALS)
    assert os.listdir() == ["scan.ply"]
    cn.denoise_large_file("scan.ply", "parts.ply", memory=1, **SETTINGS)
    cn.denoise_file("scan.ply", "whole.ply", **SETTINGS)
    assert Path("parts.ply").read_bytes() == Path("whole.ply").read_bytes()


def test_regions_that_share_walls_are_refused(place):
    """A cube with a wall across its middle has two regions, which see one another; a fin on a ball is no wall."""
    box = cube(6)
    middle = np.flatnonzero(np.abs(box.vertices[:, 0]) < 1e-12)
    assert len(middle) > 10
    around = np.argsort(np.arctan2(box.vertices[middle, 1], box.vertices[middle, 2]))
    ring = middle[around]
    wall = np.stack([ring, np.roll(ring, -1), np.full(len(ring), len(box.vertices))], axis=1)
    walled = Mesh(np.append(box.vertices, [[0, 0, 0]], axis=0), np.concatenate([box.faces, wall]))
    assert shells(oriented(walled)) is not None
    save_mesh(place / "walled.ply", walled)
    with pytest.raises(cn.ReadError, match="regions of the mesh share walls"):
        cn.denoise_large_file("walled.ply", "out.ply", memory=1, **SETTINGS)
    a, b = BALL.faces[0, :2].tolist()
    finned = Mesh(
        np.append(BALL.vertices, [2 * BALL.vertices[a]], axis=0), [*BALL.faces.tolist(), [a, b, len(BALL.vertices)]]
    )
    save_mesh(place / "finned.ply", finned)
    cn.denoise_large_file("finned.ply", "parts.ply", memory=1, **NORMALS)
    cn.denoise_file("finned.ply", "whole.ply", **NORMALS)
    assert Path("parts.ply").read_bytes() == Path("whole.ply").read_bytes()


KILLED = """
from cascadenorm.streaming import streaming
streaming.SMALLEST = 300
def tell(fraction):
    print(fraction, flush=True)
given = {"method": "bilateral-normal", "parameters": {"iterations": 2, "sweeps": 1}}
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
    cn.denoise_large_file("scan.ply", "out.ply", memory=1, **NORMALS)
    cn.denoise_file("scan.ply", "whole.ply", **NORMALS)
    assert (place / "out.ply").read_bytes() == (place / "whole.ply").read_bytes()


def test_binary_stl_is_welded_on_disk(place):
    """Vertices are numbered, sums taken and normals written as in memory; a triangle that stays keeps its normal."""
    mesh = side_by_side(shuffled(BALL), SHEET)
    content = Content(mesh.vertices * 3 + [10, 0, 0], Polygons.from_rows(mesh.faces.astype(np.int64)))
    data = bytearray(b"".join(StlFile.encode(content)[0]))
    data[84 : 84 + 12] = np.array([9, 9, 9], "<f4").tobytes()  # no unit normal
    Path("scan.stl").write_bytes(data)
    for settings in (SETTINGS, NORMALS):
        cn.denoise_file("scan.stl", "whole.stl", **settings, force=True)
        cn.denoise_large_file("scan.stl", "parts.stl", memory=1, **settings, force=True)
        assert Path("parts.stl").read_bytes() == Path("whole.stl").read_bytes()
    still = {"method": "taubin", "parameters": {"iterations": 0}}
    cn.denoise_large_file("scan.stl", "parts.stl", memory=1, **still, force=True)
    assert Path("parts.stl").read_bytes() == data
    Path("text.stl").write_bytes(b"solid\nfacet normal 0 0 1\nouter loop\nendsolid\n")
    with pytest.raises(cn.ReadError, match="is not binary STL"):
        cn.denoise_large_file("text.stl", "parts.stl", memory=1, **SETTINGS, force=True)
    with pytest.raises(cn.OutputError, match=r"out\.ply is not a \.stl file, as scan\.stl"):
        cn.denoise_large_file("scan.stl", "out.ply", memory=1, **SETTINGS)


def test_more_triangles_than_corners_can_be_numbered_are_refused(place):
    count = 2**32 // 3 + 1
    with Path("scan.stl").open("wb") as file:
        file.write(bytes(80) + count.to_bytes(4, "little"))
        file.truncate(84 + 50 * count)  # 72 GB, of which the disk holds none
    with pytest.raises(
        cn.ReadError, match="has 1,431,655,766 triangles, and at most 1,431,655,765 can be read in parts"
    ):
        cn.denoise_large_file("scan.stl", "parts.stl", memory=1, **SETTINGS)


def test_places_of_negative_zero_are_those_of_zero(place):
    corners = BALL.vertices[BALL.faces].astype("<f4")
    corners[np.abs(corners) < 0.02] = 0
    corners[::2][corners[::2] == 0] = -0.0
    records = np.zeros(len(corners), RECORD)
    records["corners"] = corners
    Path("scan.stl").write_bytes(bytes(80) + len(records).to_bytes(4, "little") + records.tobytes())
    assert (np.signbit(corners) & (corners == 0)).any()
    cn.denoise_file("scan.stl", "whole.stl", **SETTINGS)
    cn.denoise_large_file("scan.stl", "parts.stl", memory=1, **SETTINGS)
    assert Path("parts.stl").read_bytes() == Path("whole.stl").read_bytes()


def test_ctrl_c_says_how_to_go_on(place):
    save_mesh(place / "scan.ply", noisy(icosphere(5), 0.1))
    words = [sys.executable, "-m", "cascadenorm", "denoise", "scan.ply", "-o", "out.ply", "--memory", "1MB"]
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as process:
        while process.poll() is None and not list(place.glob(".out.ply.parts/*")):
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 130 and (place / ".out.ply.parts").exists()
    assert "the same command goes on from there" in said and "interrupted" in said and len(said.splitlines()) == 2


def test_files_that_do_not_fit_are_denoised_in_patches(place, capsys, monkeypatch):
    save_mesh(place / "scan.ply", BALL)
    words = ["denoise", "scan.ply", "--method", "bilateral-normal", "--set", "iterations=2", "--set", "sweeps=1"]
    assert run([*words, "-o", "whole.ply"]) == 0
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(fitting, "free_memory", lambda: 1_000_000)
    assert run([*words, "-o", "parts.ply"]) == 0
    said = capsys.readouterr().err
    assert "needs about 3 MB for 5,120 faces, and 1 MB are free: it is denoised in patches" in said
    assert len(said.splitlines()) == 1
    assert Path("parts.ply").read_bytes() == Path("whole.ply").read_bytes()
    refused = [
        ([*words[:3], "l0"], "l0 depends on the whole mesh", ": choose one of auto, bilateral-normal, cascade"),
        ([*words, "--only", "0"], "only needs the whole mesh in memory", ": leave it out, or "),
        ([*words, "--keep-volume"], "volume depends on the whole mesh", ": leave it out, or "),
        (["denoise", "scan.ply", "--keep-volume"], "volume depends on the whole mesh", ": leave it out, or "),
    ]
    for chosen, why, way_out in refused:
        assert run([*chosen, "-o", "other.ply"]) == 2
        said = capsys.readouterr().err
        assert why in said and way_out in said and len(said.splitlines()) == 1
        assert said.count("choose one of") == (why[:2] == "l0")
    assert run([*words, "-o", "whole.ply"]) == 5  # is there already
    assert "whole.ply exists already" in capsys.readouterr().err
    save_mesh(place / "scan.off", BALL)
    settings = {"method": "auto", "force": False, "parameters": {}, "controls": {}}
    assert fitting.memory_for_patches("scan.off", None, **settings) is None
    monkeypatch.setattr(fitting, "free_memory", lambda: None)  # not Linux
    assert fitting.memory_for_patches("scan.ply", None, **settings) is None


LIMITED = """
import resource, sys
import cascadenorm as cn
from cascadenorm.streaming import ply_rows, streaming
ply_rows.BLOCK, streaming.SMALLEST = 20_000, 10_000
given = {"method": "bilateral-normal", "parameters": {"iterations": 2, "sweeps": 1}}
cn.denoise_file("small.ply", "small_whole.ply", **given, force=True)  # kernels and threads are there from now on
cn.denoise_large_file("small.ply", "small_parts.ply", memory=1, **given, force=True)
used = next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmData:")) * 1024
resource.setrlimit(resource.RLIMIT_DATA, (used + 60_000_000,) * 2)
if sys.argv[1] == "parts":
    cn.denoise_large_file("large.ply", "parts.ply", memory=1, **given)
else:
    cn.denoise_file("large.ply", "whole.ply", **given)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory are Linux's")
def test_patches_stay_within_a_limit_that_the_whole_exceeds(tmp_path):
    save_mesh(tmp_path / "small.ply", SHEET)
    save_mesh(tmp_path / "large.ply", noisy(grid(400, 300), 0.15))
    for way, ends in (("parts", True), ("whole", False)):
        done = subprocess.run([sys.executable, "-c", LIMITED, way], cwd=tmp_path, capture_output=True, text=True)
        assert (done.returncode == 0) == ends, done.stderr
    assert "MemoryError" in done.stderr or "allocat" in done.stderr or "thread" in done.stderr
    assert (tmp_path / "parts.ply").stat().st_size == (tmp_path / "large.ply").stat().st_size


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: data[:-7], "it is truncated"),
        (lambda data: b"v 0 0 0", "the file is not PLY, and only binary PLY and STL can be read in parts: convert it"),
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
        (["--method", "l0"], "l0 depends on the whole mesh"),
        (["--keep-volume"], "--keep-volume depends on the whole mesh"),
        (["--method", "bilateral-normal", "--set", "fit=least-squares"], "bilateral-normal depends on the whole mesh"),
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
