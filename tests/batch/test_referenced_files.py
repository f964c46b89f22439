"""Materials and textures of the meshes of a batch: their copies beside the results follow their sources."""

import json
from pathlib import Path

import numpy as np
import pytest
from batches import BALL, FAST, lines
from gltfs import VEC3
from shapes import noisy

from cascadenorm.batch import batch
from cascadenorm.batch.batch import denoise_files
from cascadenorm.cli import run
from cascadenorm.io.interop import save_mesh


class InThisProcess:
    """Processes of a batch that need no start: the work is done at once, in the process of the test."""

    def __init__(self, work, place) -> None:
        self._work, self._done, self.places = work, [], [place]

    def begin(self, place, task, threads) -> None:
        self._done.append((task.job, self._work(task)))

    def ended(self, seconds):
        done, self._done = self._done, []
        return done

    def close(self) -> None:
        pass


BATCH = ["batch", "scans", "-o", "out", *FAST, "--workers", "1"]


def scan(name: str, seed: int = 0) -> Path:
    """Write an OBJ file that uses the materials of paint.mtl."""
    path = Path("scans", name)
    save_mesh(path, noisy(BALL, 0.2, seed=seed), force=True)
    path.write_bytes(b"mtllib paint.mtl\nusemtl red\n" + path.read_bytes())
    return path


def replace(name: str, content: bytes) -> None:
    Path("scans", name).write_bytes(content)


def copy(name: str) -> bytes:
    return Path("out", name).read_bytes()


@pytest.fixture
def painted(place, monkeypatch):
    """A batch of two meshes with the same materials and texture, which is done."""
    monkeypatch.setattr(batch, "LocalProcesses", InThisProcess)
    (place / "scans").mkdir()
    replace("paint.mtl", b"newmtl red\nmap_Kd wood.png\n")
    replace("wood.png", b"oak")
    for number, name in enumerate(("a.obj", "b.obj")):
        scan(name, number)
    assert run(BATCH) == 0
    return place


def denoised() -> set[str]:
    """Run the batch again without failures; return the names of the files that were denoised."""
    done = denoise_files("scans", "out", method="laplacian", workers=1)
    assert not done.failures
    return {line["output"] for line in done.lines}


def test_copies_follow_their_sources(painted):
    assert (denoised(), copy("wood.png")) == (set(), b"oak")
    replace("wood.png", b"pine")
    assert (denoised(), copy("wood.png")) == ({"a.obj", "b.obj"}, b"pine")
    replace("paint.mtl", b"newmtl red\nmap_Kd wood.png\nmap_Ks gloss.png\n")
    assert denoised() == {"a.obj", "b.obj"} and b"gloss" in copy("paint.mtl")
    replace("gloss.png", b"was missing")
    assert (denoised(), copy("gloss.png")) == ({"a.obj", "b.obj"}, b"was missing")
    Path("out", "wood.png").unlink()
    denoised()
    assert (denoised(), copy("wood.png")) == (set(), b"pine")
    Path("scans", "gloss.png").unlink()
    assert denoised() == {"a.obj", "b.obj"} and lines(painted / "out", "done")[-1]["copies"]["gloss.png"] is None
    assert denoised() == set()


def test_a_new_mesh_uses_materials_that_have_changed(painted):
    replace("paint.mtl", b"newmtl red\nKd 1 0 0\n")
    larger = scan("c.obj")
    larger.write_bytes(larger.read_bytes() + b"# the largest file is denoised first\n")
    assert denoised() == {"a.obj", "b.obj", "c.obj"} and b"Kd" in copy("paint.mtl")


def test_a_result_that_was_deleted_is_written_again_with_new_materials(painted):
    for name in ("a.obj", "b.obj"):
        Path("out", name).unlink()
    replace("wood.png", b"pine")
    assert (denoised(), copy("wood.png")) == ({"a.obj", "b.obj"}, b"pine")


def test_copies_that_were_edited_are_kept(painted, capsys):
    Path("out", "wood.png").write_bytes(b"edited")
    assert (denoised(), copy("wood.png")) == (set(), b"edited")
    replace("wood.png", b"pine")
    assert run(BATCH) == 6
    assert "wood.png exists already and differs from the referenced file 'wood.png'" in capsys.readouterr().err
    scan("a.obj", seed=5)
    assert run(BATCH) == 6 and copy("wood.png") == b"edited"
    assert run([*BATCH, "--force"]) == 0 and copy("wood.png") == b"pine"


def test_files_that_no_batch_has_written_are_kept_when_a_mesh_begins_to_use_them(painted):
    Path("out", "gloss.png").write_bytes(b"precious")
    replace("gloss.png", b"gloss")
    replace("paint.mtl", b"newmtl red\nmap_Ks gloss.png\n")
    assert run(BATCH) == 6 and copy("gloss.png") == b"precious"


def test_textures_in_a_linked_folder_are_neither_copied_nor_compared(painted):
    Path("elsewhere").mkdir()
    Path("elsewhere", "wood.png").write_bytes(b"precious")
    Path("out", "maps").symlink_to(Path("elsewhere").absolute())
    Path("scans", "maps").mkdir()
    replace("maps/wood.png", b"oak")
    replace("paint.mtl", b"newmtl red\nmap_Kd maps/wood.png\n")
    assert denoised() == {"a.obj", "b.obj"} and copy("maps/wood.png") == b"precious"
    assert denoised() == set()
    scan("a.obj", seed=5)
    assert denoised() == {"a.obj"}


def test_another_format_has_no_copies(painted):
    words = ["batch", "scans", "-o", "stl", *FAST, "--format", "stl", "--workers", "1"]
    assert run(words) == 0
    replace("wood.png", b"pine")
    assert run(words) == 0 and len(lines(painted / "stl", "done")) == 2


@pytest.mark.parametrize("larger", ["part", "scene"])
def test_a_scene_uses_the_results_of_the_layers_that_it_references(larger, place, monkeypatch):
    """The larger file is denoised first."""
    pytest.importorskip("pxr")
    monkeypatch.setattr(batch, "LocalProcesses", InThisProcess)
    (place / "scans").mkdir()
    replace("paint.usda", b"#usda 1.0\n")
    for seed, name in enumerate(("part", "scene")):
        path = Path("scans", f"{name}.usda")
        save_mesh(path, noisy(BALL, 0.2, seed=seed))
        reference = b'def "more" (\n references = [@./part.usda@</mesh>, @paint.usda@]\n) {\n}\n' * (name == "scene")
        path.write_bytes(path.read_bytes() + reference + b"# larger\n" * 99 * (name == larger))
    denoise_files("scans", "out", method="laplacian", workers=1)
    assert copy("part.usda") != Path("scans", "part.usda").read_bytes() and copy("paint.usda") == b"#usda 1.0\n"
    assert {line["output"] for line in lines(place / "out", "done")} == {"part.usda", "scene.usda"}
    Path("scans", "scene.usda").write_bytes(Path("scans", "scene.usda").read_bytes() + b"# changed\n")
    result = copy("part.usda")
    again = denoise_files("scans", "out", method="laplacian", workers=1)
    assert [line["output"] for line in again.lines if line["status"] == "done"] == ["scene.usda"]
    assert copy("part.usda") == result


def test_a_buffer_of_another_result_is_not_replaced(place, monkeypatch, capsys):
    """The vertices of ball.gltf move into a new ball.bin; flat.gltf uses ball.bin, and its triangle does not move."""
    monkeypatch.setattr(batch, "LocalProcesses", InThisProcess)
    (place / "scans").mkdir()
    ball = noisy(BALL, 0.2)
    data = [ball.vertices.astype("<f4").tobytes(), ball.faces.astype("<u2").tobytes(), np.eye(3, dtype="<f4").tobytes()]
    replace("ball.bin", b"".join(data))
    ends = np.cumsum([0, *map(len, data)]).tolist()
    views = [{"buffer": 0, "byteOffset": at, "byteLength": len(part)} for at, part in zip(ends, data, strict=False)]
    accessors = [
        {"bufferView": 0, **VEC3, "count": len(ball.vertices)},
        {"bufferView": 1, "componentType": 5123, "type": "SCALAR", "count": ball.faces.size},
        {"bufferView": 2, **VEC3, "count": 3},
    ]
    primitives = {"ball": {"attributes": {"POSITION": 0}, "indices": 1}, "flat": {"attributes": {"POSITION": 2}}}
    for name, primitive in primitives.items():
        document = {"asset": {"version": "2.0"}, "meshes": [{"primitives": [primitive]}], "accessors": accessors}
        document |= {"bufferViews": views, "buffers": [{"uri": "ball.bin", "byteLength": ends[-1]}]}
        replace(f"{name}.gltf", json.dumps(document).encode())  # the larger document, ball.gltf, is denoised first
    words = ["batch", "scans", "-o", "out", "--method", "bilateral-normal", "--workers", "1"]
    assert run(words) == 6
    moved = copy("ball.bin")
    assert moved != b"".join(data) and run(words) == 6 and copy("ball.bin") == moved
    assert capsys.readouterr().err.count("ball.bin exists already and differs from the referenced file") == 2
    Path("out", "ball.gltf").unlink()
    assert run(words) == 6 and copy("ball.bin") == moved and Path("out", "ball.gltf").exists()
