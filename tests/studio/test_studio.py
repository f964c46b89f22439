"""The studio's server, asked as a page asks it."""

import io
import json
import os
import shlex
import signal
import socket
import sys
from pathlib import Path
from urllib.parse import unquote
from zipfile import ZipFile

import numpy as np
import pytest
from shapes import icosphere, noisy
from studios import Studio, until

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.io.interop import save_mesh
from cascadenorm.registry.controls import CONTROLS

ROUGH = noisy(icosphere(3), 0.2)
LAPLACIAN = {"method": "laplacian", "parameters": {"iterations": "2"}, "controls": {"strength": "0.5"}}


def scanned(path, mesh=ROUGH):
    """Write a PLY file with properties that a result has to keep."""
    count = len(mesh.vertices)
    kinds = [("x", "f4"), ("y", "f4"), ("z", "f4"), ("quality", "f4"), ("label", "u1")]
    vertices = np.empty(count, kinds)
    for name, values in zip("xyz", mesh.vertices.T, strict=True):
        vertices[name] = values
    vertices["quality"], vertices["label"] = np.linspace(0, 1, count), np.arange(count) % 7
    faces = np.empty(len(mesh.faces), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.faces
    head = (
        f"ply\nformat binary_little_endian 1.0\ncomment by hand\nelement vertex {count}\nproperty float x\n"
        "property float y\nproperty float z\nproperty float quality\nproperty uchar label\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    path.write_bytes(head.encode() + vertices.tobytes() + faces.tobytes())
    return path


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    folder = tmp_path_factory.mktemp("studio")
    scanned(folder / "scan.ply")
    started = Studio("scan.ply", "--max-size", "0.5", folder=folder)
    started.folder = folder
    with started.told() as events:  # an open page, without which the studio ends
        until(events, type="opened")
        yield started
    started.close()


# who may ask


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 200),
        ({"authorization": None}, 401),
        ({"authorization": "Bearer "}, 401),
        ({"authorization": "Bearer wrong"}, 401),
        ({"authorization": "Bearer té"}, 401),
        ({"host": "attacker.example"}, 403),
        ({"host": "127.0.0.1"}, 403),
        ({"host": "127.0.0.1.attacker.example"}, 403),
        ({"origin": "http://attacker.example"}, 403),
        ({"origin": "null"}, 403),
        ({"origin": None}, 403),
        ({"sec_fetch_site": "cross-site"}, 403),
        ({"sec_fetch_site": "same-site"}, 403),
    ],
    ids=str,
)
def test_only_its_own_page_with_the_token_is_answered(studio, headers, status):
    found, answer = studio.asked("POST", "/api/recipe", {"settings": LAPLACIAN, "name": "out.ply"}, **headers)
    assert found == status
    assert ("command" in answer) == (status == 200)


def test_the_port_of_another_server_is_no_origin(studio):
    assert studio.asked("POST", "/api/cancel", {}, origin=f"http://127.0.0.1:{int(studio.port) + 1}")[0] == 403
    assert studio.asked("POST", "/api/cancel", {}, origin=f"https://{studio.host}")[0] == 403


def test_the_page_is_served_without_a_token_and_loads_nothing_from_elsewhere(studio):
    status, page = studio.asked("GET", "/", authorization=None, origin=None)
    assert status == 200 and b"/studio.js" in page and b"http" not in page.replace(b"http-equiv", b"")
    assert "default-src 'none'" in studio.headers["content-security-policy"]
    assert "frame-ancestors 'none'" in studio.headers["content-security-policy"]
    assert studio.headers["cross-origin-resource-policy"] == "same-origin"
    assert "access-control-allow-origin" not in studio.headers
    assert studio.asked("GET", "/", host="attacker.example")[0] == 403


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has all of 127.0.0.0/8 on its loopback interface")
def test_other_addresses_of_this_machine_are_not_served(studio):
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.2", int(studio.port)))


# no path outside what was opened


@pytest.mark.parametrize("name", ["../out.ply", "/tmp/out.ply", "a/b.ply", "..", ".out.ply", "a\\b.ply", "", None, 7])
def test_results_are_saved_beside_the_file_alone(studio, name):
    before = sorted(studio.folder.parent.rglob("*"))
    for path in ("/api/save", "/api/download", "/api/recipe"):
        status, answer = studio.asked("POST", path, {"settings": LAPLACIAN, "name": name})
        assert status == 400 and "plain file name" in answer["error"]
    assert sorted(studio.folder.parent.rglob("*")) == before


WINDOWS = pytest.mark.skipif(sys.platform != "win32", reason="a drive only on Windows")


@pytest.mark.parametrize(
    "name",
    ["../evil.ply", "%2Fetc%2Fpasswd", "..%2F..%2Fevil.ply", "a%00.ply", pytest.param("c:evil.ply", marks=WINDOWS)],
)
def test_dropped_files_have_plain_names(studio, name):
    drop = studio.done("/api/drop")["drop"]
    status, answer = studio.asked("POST", f"/api/drop/{drop}?name={name}", b"ply\n")
    assert status == 400 and "plain file name" in answer["error"]
    status, answer = studio.asked("POST", "/api/open", {"drop": drop, "names": ["../../scan.ply"]})
    assert status == 400 and "plain file name" in answer["error"]


@pytest.mark.parametrize("number", ["9" * 5000, "-1", "1.0", "x"])
def test_a_number_that_was_not_given_out_is_not_found(studio, number):
    assert studio.asked("GET", f"/api/scene/{number}")[0] == studio.asked("GET", f"/api/saved/{number}")[0] == 404
    status, answer = studio.asked("POST", f"/api/drop/{number}?name=a.ply", b"ply\n")
    assert status == 400 and "nothing was dropped" in answer["error"]


@pytest.mark.parametrize("path", ["/../page.py", "/%2e%2e/server.py", "/server.py", "/api/scene/..%2f1", "/etc/passwd"])
def test_no_other_file_is_served(studio, path):
    assert studio.asked("GET", path)[0] == 404


@pytest.mark.parametrize(
    "settings",
    [
        {"controls": {"mask": "/tmp/weights.npy"}},
        {"controls": {"fixed": "secret.TXT"}},
        {"controls": {"creases": "edges.txt "}},
        {"parameters": {"model": "weights.safetensors"}},
    ],
    ids=str,
)
def test_settings_name_no_files(studio, settings):
    status, answer = studio.asked("POST", "/api/recipe", {"settings": settings, "name": "out.ply"})
    assert status == 400 and "reads no file but the mesh" in answer["error"]


def test_what_is_too_large_is_refused_and_not_kept(studio):
    drop = studio.done("/api/drop")["drop"]
    status, answer = studio.asked("POST", f"/api/drop/{drop}?name=large.ply", bytes(600_000))
    assert status == 413 and "0.5 MB" in answer["error"] and "--max-size" in answer["error"]
    studio.done(f"/api/drop/{drop}?name=a.ply", bytes(300_000))  # two together
    assert studio.asked("POST", f"/api/drop/{drop}?name=b.ply", bytes(300_000))[0] == 413
    status, answer = studio.asked("POST", "/api/open", {"drop": drop, "names": ["large.ply"]})
    assert (status, answer["error"]) == (400, "large.ply was not received: drop it again")
    assert studio.asked("POST", "/api/recipe", b"[" * 2_000_000)[0] == 413
    assert studio.asked("POST", "/api/paint", bytes(100_000))[0] == 413


@pytest.mark.parametrize("body", [b"", b"[]", b"{", b"[" * 100_000, b'{"settings": 3}', b"\xff"], ids=repr)
def test_requests_that_make_no_sense_are_answered(studio, body):
    status, answer = studio.asked("POST", "/api/denoise", body)
    assert status == 400 and answer["error"]


# the work


def settings(**controls):
    return {**LAPLACIAN, "controls": {name: str(value) for name, value in controls.items()}}


def denoised(studio, events, asked, ticket="t"):
    studio.done("/api/denoise", {"settings": asked, "ticket": ticket})
    return until(events, ticket=ticket, type="shown", coarse=False)


def test_a_result_is_saved_with_all_that_the_file_holds_as_the_command_line_saves_it(studio, monkeypatch):
    with studio.told() as events:
        assert until(events, type="opened")["faces"] == len(ROUGH.faces)
        shown = denoised(studio, events, LAPLACIAN)
    assert shown["moved"] == len(ROUGH.vertices)
    done = studio.done("/api/save", {"settings": LAPLACIAN, "name": "out.ply"})
    assert (done["file"], done["left_out"]) == ("out.ply", [])
    saved = (studio.folder / "out.ply").read_bytes()
    (listed,) = done["files"]
    assert listed["path"] == str(studio.folder / "out.ply")
    assert studio.asked("GET", f"/api/saved/{listed['number']}") == (200, saved)
    assert studio.asked("GET", f"/api/saved/{listed['number']}", authorization=None)[0] == 401
    assert studio.asked("GET", f"/api/saved/{listed['number'] + 1}")[0] == 404
    (studio.folder / "out.ply").unlink()

    monkeypatch.chdir(studio.folder)
    command = shlex.split(done["command"])
    assert command[:3] == ["cascadenorm", "denoise", "scan.ply"] and "--strength" in command
    assert run(command[1:]) == 0
    assert (studio.folder / "out.ply").read_bytes() == saved
    (studio.folder / "out.ply").unlink()
    exec(done["python"], {})
    assert (studio.folder / "out.ply").read_bytes() == saved

    source, out = (cn.read(studio.folder / name).content().vertex_values for name in ("scan.ply", "out.ply"))
    for name in ("quality", "label"):
        np.testing.assert_array_equal(out[name], source[name])
    status, answer = studio.asked("POST", "/api/save", {"settings": LAPLACIAN, "name": "out.ply"})
    assert status == 400 and answer["remedy"] == ["force", True] and answer["existing"] == ["out.ply"]
    studio.done("/api/save", {"settings": LAPLACIAN, "name": "out.ply", "force": True})
    assert (studio.folder / "out.ply").read_bytes() == saved


@pytest.mark.parametrize("kind", ["save", "download", "recipe"])
def test_a_name_without_an_extension_is_refused(studio, kind):
    before = set(studio.folder.iterdir())
    status, answer = studio.asked("POST", f"/api/{kind}", {"settings": LAPLACIAN, "name": "out"})
    assert status == 400 and "out has no extension" in answer["error"] and "ply" in answer["error"]
    assert set(studio.folder.iterdir()) == before


def test_the_form_has_every_method_and_control_and_its_defaults_change_nothing(studio):
    form = studio.asked("GET", "/api/form")[1]
    assert sorted(method["name"] for method in form["methods"]) == list(cn.methods())
    families = [method["family"] for method in form["methods"]]
    assert families[0] == "Learned" and len(set(families)) >= 5
    assert families == sorted(families, key=families.index)  # those of a family follow each other
    assert [control["name"] for control in form["controls"]] == [n for n, c in CONTROLS.items() if not c.about.hidden]
    for method in form["methods"]:
        registered = cn.methods()[method["name"]]
        offered = {setting["name"]: setting["default"] for setting in method["settings"]}
        assert offered.keys() == {setting.name for setting in registered.given_by_name} - {"model"}
        given = {name: default for name, default in offered.items() if default}
        read = registered.checked(given)
        assert read == {name: registered.settings[name].default for name in given}


def test_what_is_out_of_range_is_said_in_the_words_of_the_form(studio):
    with studio.told() as events:
        studio.done("/api/denoise", {"settings": settings(strength=-1), "ticket": "bad"})
        failed = until(events, ticket="bad", type="failed")
        assert "“Strength” is -1; it must be at least 0" in failed["error"]
        studio.done("/api/denoise", {"settings": {"method": "magic"}, "ticket": "none"})
        assert "there is no method 'magic'" in until(events, ticket="none", type="failed")["error"]


def test_the_scene_of_a_result_completes_that_of_the_open_mesh(studio):
    with studio.told() as events:
        opened = until(events, type="opened")
        shown = denoised(studio, events, settings(strength=0.25))
        first = studio.asked("GET", f"/api/scene/{opened['scene']}")[1]
    status, scene = studio.asked("GET", f"/api/scene/{shown['scene']}")
    assert status == 200 and [mesh["name"] for mesh in first["meshes"]] == ["before"]
    assert scene["completes"] and [mesh["name"] for mesh in scene["meshes"]] == ["after"]
    assert [mesh["file"] for mesh in (*first["meshes"], *scene["meshes"])] == ["scan.ply", "scan_denoised.ply"]
    assert studio.asked("GET", f"/api/scene/{shown['scene']}", authorization="Bearer wrong")[0] == 401
    assert studio.asked("GET", "/api/scene/99999")[0] == 404


def test_a_dropped_file_with_another_that_it_names_is_downloaded_with_it(studio, tmp_path):
    rows = [f"v {x} {y} {z}" for x, y, z in ROUGH.vertices] + ["usemtl red"]
    rows += [f"f {a} {b} {c}" for a, b, c in ROUGH.faces + 1]
    (tmp_path / "part.obj").write_text("\n".join(["mtllib part.mtl", *rows]), encoding="utf-8")
    (tmp_path / "part.mtl").write_text("newmtl red\nKd 1 0 0\n", encoding="utf-8")
    try:
        assert studio.drop(tmp_path / "part.mtl", tmp_path / "part.obj")[0] == 200
        status, packed = studio.asked("POST", "/api/download", {"settings": LAPLACIAN, "name": "new.obj"})
        about = json.loads(unquote(studio.headers["x-about"]))
        assert status == 200 and about["name"] == "new.zip"
        assert about["command"].startswith("cascadenorm denoise part.obj -o new.obj ")
        with ZipFile(io.BytesIO(packed)) as archive:
            assert sorted(archive.namelist()) == ["new.obj", "part.mtl"]
            (tmp_path / "new.obj").write_bytes(archive.read("new.obj"))
        cn.denoise_file(tmp_path / "part.obj", tmp_path / "same.obj", method="laplacian", strength=0.5,
                        parameters={"iterations": 2})  # fmt: skip
        assert (tmp_path / "new.obj").read_bytes() == (tmp_path / "same.obj").read_bytes()
        status, answer = studio.asked("POST", "/api/save", {"settings": LAPLACIAN, "name": "new.obj"})
        assert status == 400 and "download the result" in answer["error"]
    finally:
        assert studio.drop(studio.folder / "scan.ply")[0] == 200


def test_paint_is_downloaded_with_the_result(studio):
    codes = np.zeros(len(ROUGH.vertices), np.uint8)
    codes[:10], codes[10:30] = 255, 51
    try:
        studio.done("/api/paint", codes.tobytes())
        status, packed = studio.asked("POST", "/api/download", {"settings": LAPLACIAN, "name": "new.ply"})
        about = json.loads(unquote(studio.headers["x-about"]))
        assert status == 200 and about["name"] == "new.zip"
        assert about["files"] == ["new.ply", "new_fixed.npy", "new_mask.npy"]
        with ZipFile(io.BytesIO(packed)) as archive:
            assert sorted(archive.namelist()) == about["files"]
            fixed, mask = (np.load(io.BytesIO(archive.read(f"new_{name}.npy"))) for name in ("fixed", "mask"))
            (studio.folder / "new.ply").write_bytes(archive.read("new.ply"))
        np.testing.assert_array_equal(np.flatnonzero(fixed), np.arange(10))
        np.testing.assert_array_equal(np.flatnonzero(mask == 0.5), np.arange(10, 30))
        source, out = (cn.read(studio.folder / name).mesh.vertices for name in ("scan.ply", "new.ply"))
        assert np.flatnonzero((source == out).all(axis=1)).tolist() == list(range(10))
    finally:
        (studio.folder / "new.ply").unlink(missing_ok=True)
        studio.done("/api/paint", bytes(len(ROUGH.vertices)))


BAD = {
    "text.ply": (b"this is a letter, not a mesh\n" * 9, "text.ply"),
    "empty.ply": (b"", "the file is empty"),
    "points.ply": (
        b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
        b"0 0 0\n",
        "no faces",
    ),
    "notes.docx": (b"PK\x03\x04 not a mesh", "not a supported mesh format"),
    "cut.ply": (b"ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\nend_header\n\0", "cut.ply"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_mesh_is_refused_with_a_reason_and_the_open_mesh_stays(studio, tmp_path, name):
    content, reason = BAD[name]
    (tmp_path / name).write_bytes(content)
    status, answer = studio.drop(tmp_path / name)
    assert status == 400 and reason in answer["error"] and "/" not in answer["error"].replace("glb/", "")
    with studio.told() as events:
        assert until(events, type="opened")["name"] == "scan.ply"


def test_bad_vertices_are_left_and_said(studio, tmp_path):
    vertices = ROUGH.vertices.copy()
    vertices[5, 0] = np.nan
    scanned(tmp_path / "bad.ply", type("Rough", (), {"vertices": vertices, "faces": ROUGH.faces}))
    try:
        assert studio.drop(tmp_path / "bad.ply")[0] == 200
        with studio.told() as events:
            assert "1 of 642 vertices are not finite" in until(events, type="opened")["notice"]
        done = studio.done("/api/recipe", {"settings": LAPLACIAN, "name": "out.ply"})
        assert "--on-bad isolate" in done["command"]
    finally:
        assert studio.drop(studio.folder / "scan.ply")[0] == 200


# a studio of its own


@pytest.fixture
def large(tmp_path):
    """A studio on a mesh that is large enough for a coarse preview."""
    save_mesh(tmp_path / "large.ply", noisy(icosphere(6), 0.2))
    started = Studio("large.ply", folder=tmp_path)
    yield started
    started.close()


SLOW = {"method": "bilateral-normal", "parameters": {"iterations": "1000000"}, "controls": {}}
"""Hours of work that reports its progress often."""


def worker_of(studio):
    """The process that works for a studio."""
    for process in Path("/proc").glob("[0-9]*"):
        try:
            parent = int(process.joinpath("stat").read_text().rpartition(")")[2].split()[1])
            command = process.joinpath("cmdline").read_text()
        except OSError:
            continue
        if parent == studio.process.pid and "spawn_main" in command:
            return int(process.name)
    raise AssertionError("there is no worker")


@pytest.mark.skipif(sys.platform != "linux", reason="finds the worker in /proc")
def test_a_coarse_preview_comes_first_newer_requests_end_older_ones_and_a_crash_ends_nothing_else(large):
    with large.told() as events:
        until(events, type="opened")

        # coarse, then whole
        large.done("/api/denoise", {"settings": LAPLACIAN, "ticket": "first"})
        coarse, whole = (until(events, ticket="first", type="shown") for _ in range(2))
        assert coarse["coarse"] and not whole["coarse"]
        few, many = (large.asked("GET", f"/api/scene/{one['scene']}")[1]["meshes"] for one in (coarse, whole))
        assert few[-1]["positions"]["shape"][0] < many[-1]["positions"]["shape"][0] / 2
        assert few[-1]["faces"] == many[-1]["faces"] == 81920

        # another strength only blends what is known, so that no coarse mesh comes before it
        large.done("/api/denoise", {"settings": {**LAPLACIAN, "controls": {"strength": "0.25"}}, "ticket": "weak"})
        assert not until(events, ticket="weak", type="shown")["coarse"]

        # a newer one, and cancelling
        large.done("/api/denoise", {"settings": SLOW, "ticket": "old"})
        until(events, ticket="old", type="progress")
        large.done("/api/denoise", {"settings": settings(strength=0.75), "ticket": "new"})
        until(events, ticket="old", type="cancelled")
        until(events, ticket="new", type="shown", coarse=False)
        large.done("/api/denoise", {"settings": SLOW, "ticket": "long"})
        told = until(events, ticket="long", type="progress")
        assert 0 <= told["fraction"] < 1
        large.done("/api/cancel")
        until(events, ticket="long", type="cancelled")

        # a crash
        large.done("/api/denoise", {"settings": SLOW, "ticket": "killed"})
        until(events, ticket="killed", type="progress")
        os.kill(worker_of(large), signal.SIGKILL)
        error = until(events, ticket="killed", type="failed")["error"]
        assert "SIGKILL" in error and error.endswith("The next request starts another process.")
        large.done("/api/denoise", {"settings": LAPLACIAN, "ticket": "again"})
        until(events, ticket="again", type="shown", coarse=False)

        # work that does not come to its end by itself
        large.done("/api/denoise", {"settings": SLOW, "ticket": "stuck"})
        until(events, ticket="stuck", type="progress")
        os.kill(worker_of(large), signal.SIGSTOP)
        large.done("/api/denoise", {"settings": settings(strength=0.25), "ticket": "next"})
        until(events, ticket="stuck", type="cancelled")
        until(events, ticket="next", type="shown", coarse=False)

        # the last page is closed in the middle of work
        large.done("/api/denoise", {"settings": SLOW, "ticket": "left"})
        until(events, ticket="left", type="progress")
        worker = worker_of(large)
    assert large.ended() == 0
    assert not Path(f"/proc/{worker}").exists()


@pytest.mark.parametrize(
    ("content", "code"),
    [
        ("no mesh", 3),
        ("", 3),
        ("ply\nformat ascii 1.0\nelement vertex 9\nproperty float x\n", 3),
        (
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
            "element face 0\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n",
            4,
        ),
    ],
)
def test_a_file_that_is_no_mesh_is_refused_in_the_words_of_denoise(tmp_path, capsys, content, code):
    bad = tmp_path / "bad.ply"
    bad.write_text(content, encoding="utf-8", newline="")
    assert run(["denoise", str(bad)]) == code
    told = capsys.readouterr().err
    assert run(["studio", "--no-browser", str(bad)]) == code
    assert capsys.readouterr().err == told


def test_what_cannot_be_served_is_said_on_the_command_line(tmp_path, capsys):
    scanned(tmp_path / "scan.ply")
    assert run(["studio", "--no-browser", str(tmp_path / "none.ply")]) == 3
    assert "does not exist" in capsys.readouterr().err
    assert run(["studio", "--no-browser", str(tmp_path)]) == 3
    assert "is a folder" in capsys.readouterr().err
    assert run(["studio", "--no-browser", str(tmp_path / "scan.ply"), "--max-size", "0.001"]) == 3
    assert "exceeds the limit of the studio" in capsys.readouterr().err
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        assert run(["studio", "--no-browser", "--port", port]) == 5
    assert f"port {port} cannot be used" in capsys.readouterr().err


def test_a_tab_that_was_discarded_finds_its_paint_again(studio):
    codes = np.zeros(len(ROUGH.vertices), np.uint8)
    codes[:10] = 255
    with studio.told(leaves=False) as events:
        until(events, type="opened")
        studio.done("/api/paint", codes.tobytes())
    assert studio.asked("GET", "/api/kept-paint")[1] == codes.tobytes()
    studio.done("/api/paint", bytes(len(ROUGH.vertices)))


def test_pages_are_told_which_of_them_has_changed_the_paint(studio):
    codes = np.zeros(len(ROUGH.vertices), np.uint8)
    with studio.told() as events:
        until(events, type="opened")
        for page, pinned in [("same", 0), ("first", 10), ("again", 10), ("second", 0)]:
            codes[:] = np.arange(len(codes)) < pinned
            studio.done(f"/api/paint?page={page}", codes.tobytes())
        assert [until(events, type="painted")["page"] for _ in range(2)] == ["first", "second"]


@pytest.mark.parametrize("place", ["name", "settings"])
def test_half_of_a_surrogate_pair_is_refused(studio, place):
    asked = {"settings": LAPLACIAN, "name": "out.ply"}
    asked |= {"name": "\ud800.ply"} if place == "name" else {"settings": {"method": "\ud800"}}
    status, answer = studio.asked("POST", "/api/recipe", asked)
    assert status == 400 and "valid text" in answer["error"]
    status, answer = studio.asked("POST", f"/api/drop/{studio.done('/api/drop')['drop']}?name=%ED%A0%80.ply", b"ply")
    assert status != 500, answer


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such file names")
def test_a_file_with_the_time_in_its_name_is_opened_and_saved(tmp_path):
    scanned(tmp_path / "scan 10:30?.ply")
    started = Studio("scan 10:30?.ply", folder=tmp_path)
    try:
        with started.told() as events:
            name = until(events, type="opened")["suggested"]
            started.done("/api/save", {"settings": LAPLACIAN, "name": name})
        assert (tmp_path / "scan 10:30?_denoised.ply").is_file()
    finally:
        started.close()


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are bytes on Linux alone")
def test_a_file_whose_name_is_no_text_is_opened_and_its_command_is_shown(tmp_path):
    name = os.fsdecode(b"caf\xe9.ply")
    scanned(tmp_path / name)
    studio = Studio(name, folder=tmp_path)
    try:
        with studio.told() as events:
            until(events, type="opened")
            done = studio.done("/api/recipe", {"settings": LAPLACIAN, "name": "out.ply"})
            assert "denoise" in done["command"] and "out.ply" in done["command"]
    finally:
        studio.close()
