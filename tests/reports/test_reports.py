"""Reports as text: what they say, and what they hold for the viewer."""

import base64
import hashlib
import io
import json
import os
import re
import shlex
import sys
import zlib

import numpy as np
import pytest
from shapes import cube, grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.api.api import denoise_file_with_meshes
from cascadenorm.cli import run
from cascadenorm.geometry.fields import fields
from cascadenorm.io.content import Content
from cascadenorm.io.interop import save_mesh
from cascadenorm.io.ply.ply import PlyFile
from cascadenorm.mesh import Mesh
from cascadenorm.mesh.polygons import Polygons
from cascadenorm.reports import report_denoised
from cascadenorm.reports.decimation import decimated
from cascadenorm.reports.facts import command_line, python_call
from cascadenorm.reports.given import Given, given
from cascadenorm.reports.packing import in_steps, packed, packed_faces
from cascadenorm.reports.places import places
from cascadenorm.reports.scene import Comparison, viewer_scene

CLEAN = icosphere(3)
ROUGH = noisy(CLEAN, 0.2)


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_mesh(tmp_path / "rough.ply", ROUGH)
    save_mesh(tmp_path / "true.ply", CLEAN)
    return tmp_path


def unpacked(pack):
    """Undo `packed`: the twin of viewer/src/format.ts."""
    count = int(np.prod(pack["shape"]))
    planes = np.frombuffer(zlib.decompress(base64.b64decode(pack["data"])), np.uint8).reshape(pack["bytes"], count)
    folded = sum(plane.astype(np.int64) << (8 * byte) for byte, plane in enumerate(planes))
    columns = ((folded >> 1) ^ -(folded & 1)).reshape(-1, pack["shape"][0])
    if pack["differences"]:
        columns = np.cumsum(columns, axis=1)
    return columns.T.reshape(pack["shape"])


def scene_of(path):
    found = re.search(r'<script type="application/json" id="scene">(.*?)</script>', path.read_text(), re.S)
    return json.loads(found[1])


def text_of(path):
    """What stands in a report without its scripts and styles."""
    page = re.sub(r"<(script|style)\b.*?</\1>", "", path.read_text(), flags=re.S)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", page))


# packing


@pytest.mark.parametrize("differences", [False, True])
@pytest.mark.parametrize("shape", [(1,), (7,), (5, 3), (300, 3)])
@pytest.mark.parametrize(("kind", "most"), [("i4", 2**29), ("i8", 2**30)])
def test_packed_numbers_come_back(kind, most, shape, differences):
    values = np.random.default_rng(0).integers(-most, most, shape, kind)
    np.testing.assert_array_equal(unpacked(packed(values, differences=differences)), values)


def test_packed_faces_come_back():
    first, second, third = unpacked(packed_faces(CLEAN.faces)).T
    first = np.cumsum(first)
    np.testing.assert_array_equal(np.stack([first, first + second, first + third], axis=1), CLEAN.faces)


def test_numbers_in_steps_are_off_by_half_a_step_and_none_is_cut_off():
    values = np.append(np.random.default_rng(0).normal(size=5000), [np.nan, 40.0, -40.0])
    codes, start, step = in_steps(values)
    assert codes[-3] == 0 and (np.delete(codes, -3) > 0).all()
    assert step < np.abs(values[:5000]).max() / 250
    back = start + step * (codes - 1)
    assert np.nanmax(np.abs(np.where(codes > 0, back, np.nan) - values)) <= 0.5001 * step
    assert in_steps(np.full(3, np.nan)).codes.tolist() == [0, 0, 0]
    assert in_steps(np.zeros(3)).codes.tolist() == [1, 1, 1]


# what is shown


def test_small_meshes_are_shown_whole_and_large_ones_with_their_own_vertices():
    whole = decimated(ROUGH, most=len(ROUGH.faces))
    np.testing.assert_array_equal(whole.faces, ROUGH.faces)
    fewer = decimated(ROUGH, most=500)
    assert 250 < len(fewer.faces) <= 500
    drawn = Mesh(ROUGH.vertices[fewer.kept_vertices], fewer.faces)
    assert drawn.volume == pytest.approx(ROUGH.volume, rel=0.1)
    assert (np.diff(fewer.kept_faces) > 0).all()
    towards = (drawn.face_normals * ROUGH.face_normals[fewer.kept_faces]).sum(axis=1)
    assert (towards > 0).mean() > 0.9


def test_positions_are_off_by_half_a_level_and_the_result_by_as_much(place):
    out = cn.denoise(ROUGH, method="laplacian")
    cn.report("r.html", ROUGH, out)
    scene = scene_of(place / "r.html")
    before, after = scene["meshes"]
    assert (before["like"], after["like"], after["triangles"]) == (None, "before", None)
    codes = unpacked(before["positions"])
    for mesh, levels in ((ROUGH, codes), (out, codes + unpacked(after["positions"]))):
        back = np.array(scene["lower"]) + levels / scene["levels"] * scene["extent"]
        assert np.abs(back - mesh.vertices).max() <= 0.501 / scene["levels"] * max(scene["extent"])


def test_a_part_far_away_leaves_a_mesh_its_precision(place):
    vertices = np.vstack([CLEAN.vertices, np.eye(3) + 5000])
    cn.report("r.html", Mesh(vertices, np.vstack([CLEAN.faces, np.arange(3) + len(CLEAN.vertices)])))
    scene = scene_of(place / "r.html")
    codes = unpacked(scene["meshes"][0]["positions"])
    back = np.array(scene["lower"]) + codes / scene["levels"] * scene["extent"]
    assert np.abs(back - vertices).max() < 1e-3
    assert np.linalg.norm(scene["view"]["target"]) < 0.2 and max(scene["view"]["reach"]) < 1.5


@pytest.mark.parametrize("scale", [1e300, 1e-310])
def test_coordinates_of_any_size_are_shown(place, scale):
    out = cn.denoise(ROUGH, method="laplacian")
    cn.report("r.html", ROUGH.moved(ROUGH.vertices * scale), out.moved(out.vertices * scale))
    scene = scene_of(place / "r.html")
    assert max(scene["extent"]) == pytest.approx(2 * scale, rel=0.2)
    angle = next(field for field in scene["fields"] if field["name"] == "angle")
    assert 1 < angle["limits"][1] < 90


def test_meshes_with_other_faces_are_shown_beside_each_other(place):
    measures = cn.report("r.html", cube(4), truth=cube(2)).measures["mesh"]
    assert measures == cn.compare(cube(4), cube(2))
    scene = scene_of(place / "r.html")
    assert [mesh["like"] for mesh in scene["meshes"]] == [None, None]
    assert [mesh["faces"] for mesh in scene["meshes"]] == [192, 48]


def test_colors_and_the_numbers_of_faces_are_those_of_the_file(place):
    square = grid(2, 2)
    corners = np.array([[0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 7, 6], [4, 5, 8, 7]])
    red = np.arange(9, dtype=np.uint8) * 20
    values = {"red": red, "green": red[::-1].copy(), "blue": np.full(9, 7, np.uint8)}
    content = Content(square.vertices, Polygons.from_rows(corners), vertex_values=values)
    (place / "quads.ply").write_bytes(b"".join(PlyFile.encode(content)[0]))
    cn.report("r.html", "quads.ply")
    (mesh,) = scene_of(place / "r.html")["meshes"]
    np.testing.assert_array_equal(unpacked(mesh["colors"]), np.stack([*values.values()], axis=1))
    assert unpacked(mesh["numbers"]).tolist() == [0, 0, 1, 1, 2, 2, 3, 3]


# quantities


def test_what_completes_a_scene_holds_what_the_scene_of_both_holds(place):
    result = cn.denoise(ROUGH, method="laplacian")
    before, after = given("before", ROUGH), given("after", result)
    comparison = Comparison(before)
    first, rest, whole = (
        comparison.first,
        comparison.with_result(after, result.vertices),
        viewer_scene([before, after], []),
    )
    assert rest["completes"] and [mesh["name"] for mesh in rest["meshes"]] == ["after"]
    assert [field["name"] for field in rest["fields"]] == [field["name"] for field in whole["fields"]]

    lower, extent = np.array(first["lower"]), np.array(first["extent"])
    codes = unpacked(first["meshes"][0]["positions"]) + unpacked(rest["meshes"][0]["positions"])
    np.testing.assert_allclose(lower + codes / first["levels"] * extent, result.vertices, atol=extent.max() / 65_000)

    def values(field, name):
        pack = field["values"][field["of"][name]]
        return pack["start"] + pack["step"] * (unpacked(pack["codes"]) - 1), pack["step"]

    for field, same in zip(rest["fields"], whole["fields"], strict=True):
        assert field["limits"] == pytest.approx(same["limits"])
        for name in same["of"]:
            (found, step), (wanted, other) = values(field, name), values(same, name)
            np.testing.assert_allclose(found, wanted, atol=step + other)


def test_a_result_that_leaves_the_box_has_a_scene_of_its_own():
    comparison = Comparison(given("before", ROUGH))
    large = ROUGH.moved(3 * ROUGH.vertices)
    found = comparison.with_result(given("after", large), large.vertices)
    assert [mesh["name"] for mesh in found["meshes"]] == ["before", "after"] and found["extent"][0] > 5


def test_what_has_no_room_has_coarser_values_and_then_fewer_faces(monkeypatch):
    shown = [given("before", ROUGH), given("after", CLEAN)]

    def made(most):
        monkeypatch.setattr("cascadenorm.reports.scene.MOST_TEXT", most)
        found = viewer_scene(shown, [])
        arrays = re.findall(r'"data": "([^"]*)"', json.dumps(found))
        assert sum(map(len, arrays)) <= most
        angle = next(field for field in found["fields"] if field["name"] == "angle")["values"][0]
        return sum(map(len, arrays)), angle["step"], angle["codes"]["shape"][0]

    size, step, faces = made(10**6)
    assert faces == len(ROUGH.faces)
    smaller, coarser, as_many = made(size - 1)
    assert smaller < size and coarser == pytest.approx(250 / 64 * step) and as_many == faces
    assert made(smaller - 1)[2] < faces


def test_a_mesh_that_is_in_no_file_has_none_in_the_scene(place):
    named, unnamed = given("before", "rough.ply"), given("after", CLEAN)
    assert [mesh["file"] for mesh in viewer_scene([named, unnamed], [])["meshes"]] == ["rough.ply", ""]


def test_a_lifted_plane_has_moved_along_its_normal_by_its_height():
    plane = grid(3, 4)
    lifted = plane.moved(plane.vertices + np.array([0, 0, -0.25]))
    found = {field.name: field for field in fields({"before": plane, "after": lifted, "truth": plane}, unit=8.0)}
    np.testing.assert_allclose(found["displacement"].values["after"], 2.0)
    np.testing.assert_allclose(found["normal-displacement"].values["before"], -2.0)
    np.testing.assert_allclose(found["distance"].values["after"], 2.0)
    np.testing.assert_allclose(found["distance"].values["before"], 0.0, atol=1e-12)
    assert (found["angle"].values["after"] == 0).all() and (found["normal-error"].values["after"] == 0).all()
    assert found["normal-displacement"].limits == (-2.0, 2.0) and found["displacement"].limits == (0.0, 2.0)


def test_fields_of_angles_are_what_compare_measures():
    out = cn.denoise(ROUGH, method="laplacian")
    found = {field.name: field for field in fields({"before": ROUGH, "after": out, "truth": CLEAN}, unit=1.0)}
    for key, mesh in (("before", ROUGH), ("after", out)):
        assert found["normal-error"].values[key].mean() == cn.compare(mesh, CLEAN).normal_error_deg
    assert found["angle"].values["after"].mean() == cn.compare(out, ROUGH).normal_error_deg


BACK_FACES = [*ROUGH.faces, *ROUGH.faces[:, ::-1]]
MIXED = [face[:: 1 if number % 3 else -1] for number, face in enumerate(ROUGH.faces)]


@pytest.mark.parametrize(
    ("faces", "names"),
    [
        pytest.param(BACK_FACES, ["noise", "curvature", "normal-displacement"], id="every face twice"),
        pytest.param([*ROUGH.faces, (0, 0, 1)], ["noise", "curvature", "normal-displacement"], id="a repeated vertex"),
        pytest.param(MIXED, ["noise"], id="every third face flipped"),
    ],
)
def test_fields_on_vertices_are_those_of_the_surface(faces, names):
    moved = ROUGH.vertices + 0.01 * np.sin(7 * ROUGH.vertices)
    sound, other = (
        fields({"before": Mesh(ROUGH.vertices, every), "after": Mesh(moved, every)}, unit=1.0)
        for every in (ROUGH.faces, faces)
    )
    for one, expected in zip(other, sound, strict=True):
        if one.name in names:
            for key, values in expected.values.items():
                np.testing.assert_allclose(one.values[key], values, atol=1e-12)


# what is said


def test_a_report_on_a_denoised_file_has_all_that_makes_it_again(place):
    arguments = ["denoise", "rough.ply", "-o", "out.ply", "--method", "taubin", "--set", "iterations=3"]
    arguments += ["--strength", "0.5", "--keep-volume", "--fixed", "0,5,7-9"]
    assert run([*arguments, "--report", "r.html", "--truth", "true.ply"]) == 0
    text = text_of(place / "r.html")
    for name in ("rough.ply", "out.ply", "true.ply"):
        assert hashlib.sha256((place / name).read_bytes()).hexdigest() in text
    assert cn.__version__ in text and "0,5,7-9" in text
    assert f"{cn.compare('out.ply', 'true.ply').normal_error_deg:.3f}" in text
    assert len(re.findall(r"\bstrength 0\.5 1\.0\b", text)) == 1

    commands = re.findall(r"<pre><code>(.*?)</code></pre>", (place / "r.html").read_text(), re.S)
    first = (place / "out.ply").read_bytes()
    command = shlex.split(commands[0].replace("&#x27;", "'").replace("&quot;", '"'))
    assert command[0] == "cascadenorm"
    assert run([*command[1:], "--force"]) == 0
    assert (place / "out.ply").read_bytes() == first
    (place / "out.ply").unlink()
    exec(commands[1].replace("&#x27;", "'").replace("&quot;", '"'), {})
    assert (place / "out.ply").read_bytes() == first


def test_a_report_leads_with_figures_before_and_after(place):
    double = Mesh(ROUGH.vertices * np.cbrt([2, 2, 2]), ROUGH.faces)
    cn.report("r.html", ROUGH, double, truth=Mesh(CLEAN.vertices, CLEAN.faces))
    text = text_of(place / "r.html")
    noise = f"{cn.inspect(ROUGH).noise:.2g}"
    angle = f"{cn.compare(ROUGH, CLEAN).normal_error_deg:.2f}°"
    assert f"Noise {noise} → {noise} mean edge lengths" in text
    assert f"Angle to the truth {angle} → {angle}" in text
    assert "Volume +100.00 %" in text
    assert re.search(r"Self-intersecting faces \d+ → \d+ Spikes \d+ → \d+", text)
    cn.report("r.html", ROUGH, double, force=True)
    assert "Angle to the input 0.00°" in text_of(place / "r.html")
    cn.report("open.html", grid(3, 4))
    assert "Volume none open, 1 boundary loop" in text_of(place / "open.html")
    flipped = Mesh(ROUGH.vertices, [ROUGH.faces[0, ::-1], *ROUGH.faces[1:]])
    cn.report("flipped.html", flipped)
    said = text_of(place / "flipped.html")
    assert "surface closed" in said and "Volume none not an oriented manifold" in said


def test_the_kind_of_error_is_said_as_denoise_says_it(place, capsys):
    assert run(["denoise", "rough.ply", "-o", "out.ply", "--report", "r.html"]) == 0
    lines = dict(line.split(": ", 1) for line in capsys.readouterr().out.splitlines() if ": " in line)
    text = text_of(place / "r.html")
    assert f"Kind of error: {lines['kind of error']}. Treated as: {lines['treated as']}. Method: auto" in text


@pytest.mark.parametrize("truth", ["lost.ply", "points.obj"])
def test_a_true_mesh_that_cannot_be_used_is_refused_before_any_work(place, capsys, truth):
    (place / "points.obj").write_text("v 0 0 0\nv 1 0 0\n")
    words = ["denoise", "rough.ply", "-o", "out.ply", "--method", "laplacian", "--report", "r.html", "--truth", truth]
    assert run(words) == (3 if truth == "lost.ply" else 4)
    assert truth in capsys.readouterr().err
    assert not (place / "out.ply").exists() and not (place / "r.html").exists()


def test_settings_that_were_changed_are_shown_and_the_others_folded(place):
    report_denoised("r.html", denoise_file_with_meshes("rough.ply", "out.ply", method="taubin", strength=0.5))
    page = (place / "r.html").read_text()
    shown, fold = re.search(r"<h2>Method and settings</h2>(.*?)<details>(.*?)</details>", page, re.S).groups()
    rows = [re.findall(r'<th scope="row">(.*?)</th>', part) for part in (shown, fold)]
    assert rows[0] == ["strength"] and {"iterations", "boundary", "on_bad"} <= set(rows[1])
    assert f"<summary>{len(rows[1])} settings have their defaults</summary>" in fold


def test_what_was_welded_and_dropped_before_is_made_again(place, monkeypatch):
    settings = {"weld": "0.001 edges", "drop_components": "1%"}
    done = denoise_file_with_meshes("rough.ply", "smooth.ply", method="laplacian", **settings)
    report_denoised("report.html", done)
    first = (place / "smooth.ply").read_bytes()
    (place / "smooth.ply").unlink()
    words = shlex.split(command_line(done.summary))
    assert words[-4:] == ["--weld", "0.001 edges", "--drop-components", "1%"]
    assert run(words[1:]) == 0 and (place / "smooth.ply").read_bytes() == first
    assert python_call(done.summary).endswith("weld='0.001 edges', drop_components='1%')")


def test_a_file_name_that_begins_with_a_hyphen_is_no_option_of_the_command(place):
    (place / "rough.ply").rename("-h rough.ply")
    done = denoise_file_with_meshes("-h rough.ply", "-h smooth.ply", method="laplacian")
    result = place / "-h smooth.ply"
    first = result.read_bytes()
    result.unlink()
    assert run(shlex.split(command_line(done.summary))[1:]) == 0 and result.read_bytes() == first


def test_learned_methods_name_the_digest_of_their_weights(place):
    denoised = denoise_file_with_meshes("rough.ply", "out.ply", method="laplacian")
    report_denoised("plain.html", denoised)
    assert "weights of" not in text_of(place / "plain.html")
    auto = denoised._replace(summary=denoised.summary.__class__(**{**vars(denoised.summary), "method": "auto"}))
    report_denoised("auto.html", auto)
    weights = (cn.__path__[0], "weights", "auto.safetensors")
    with open("/".join(weights), "rb") as file:
        assert hashlib.sha256(file.read()).hexdigest() in text_of(place / "auto.html")


def test_findings_have_places_in_the_unit_of_the_file(place):
    vertices = np.vstack([CLEAN.vertices * 3 + 10, [[50, 0, 0]]])
    faces = np.vstack([CLEAN.faces, CLEAN.faces[5]])
    save_mesh(place / "bad.obj", Mesh(vertices, faces))
    found = cn.report("r.html", "bad.obj").inspections["mesh"]
    assert found == cn.inspect("bad.obj")
    assert found.duplicate_faces.first == (len(faces),)
    places = {(p["finding"], p["label"]): p for p in scene_of(place / "r.html")["places"]}
    copy = places["duplicate_faces", f"face {len(faces)}"]
    np.testing.assert_allclose(copy["at"], vertices[CLEAN.faces[5]].mean(axis=0), rtol=1e-6)
    alone = places["unreferenced", f"vertex {len(vertices)}"]
    np.testing.assert_allclose(alone["at"], [50, 0, 0])
    assert "1 face duplicates an earlier one" in text_of(place / "r.html")


@pytest.mark.parametrize("scale", [1e-300, 1.0, 1e307])
def test_places_of_huge_and_signalling_coordinates_are_found_in_silence(scale):
    ball = CLEAN.vertices.copy()
    faces = np.concatenate([CLEAN.faces, CLEAN.faces[:1]])
    found = cn.inspect(ball * scale, faces, self_intersections=False)
    one = given("mesh", (ball * scale, faces))
    (place,) = (place for place in places(one, found) if place.finding == "duplicate_faces")
    corners = ball[CLEAN.faces[0]]
    middle = corners.mean(axis=0)
    radius = np.linalg.norm(corners - middle, axis=1).max()
    assert place.at == pytest.approx(tuple(middle * scale)) and place.radius == pytest.approx(radius * scale)

    stored = ball.astype(np.float32)
    stored.view(np.uint32)[0, 0] = 0x7F800001  # a signalling NaN
    file = PlyFile(b"".join(PlyFile.encode(Content(stored, Polygons.from_rows(faces)))[0])).isolating()
    one = Given("mesh", "ball.ply", file)
    listed = places(one, cn.inspect(file))
    assert "duplicate_faces" in {place.finding for place in listed} and np.isfinite([p.radius for p in listed]).all()


def test_inspect_and_compare_print_the_same_with_a_report(place, capsys):
    for arguments in (["inspect", "rough.ply"], ["compare", "rough.ply", "true.ply"]):
        assert run(arguments) == 0
        plain = capsys.readouterr().out
        assert run([*arguments, "--report", "r.html", "--force"]) == 0
        assert capsys.readouterr().out == plain + "report: r.html\n"
        first = (place / "r.html").read_bytes()
        assert run([*arguments, "--report", "r.html", "--force"]) == 0
        assert (place / "r.html").read_bytes() == first
        capsys.readouterr()


def test_a_mesh_that_cannot_be_denoised_is_shown_without_what_is_bad(place):
    vertices = np.array(CLEAN.vertices)
    vertices[3] = np.nan
    with pytest.raises(cn.MeshError):
        Mesh(vertices, CLEAN.faces)
    content = Content(vertices, Polygons.from_rows(CLEAN.faces.astype(np.int64)))
    (place / "bad.ply").write_bytes(b"".join(PlyFile.encode(content)[0]))
    cn.report("r.html", "bad.ply")
    assert "1 vertex is not finite" in text_of(place / "r.html")
    (mesh,) = scene_of(place / "r.html")["meshes"]
    assert mesh["faces"] == (CLEAN.faces != 3).all(axis=1).sum()


def test_names_are_escaped_and_a_report_asks_nothing_of_the_network(place):
    save_mesh(place / "a<b>&'c.ply", ROUGH)
    cn.report("r.html", "a<b>&'c.ply")
    page = (place / "r.html").read_text()
    assert "a&lt;b&gt;&amp;&#x27;c.ply" in page and "<b>" not in page
    assert "default-src 'none'" in page
    outside = re.sub(r"<(script|style)\b.*?</\1>", "", page, flags=re.S)
    assert re.findall(r"""(?:src|href)=["'](?!data:)""", outside) == []


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has file names that are not valid Unicode")
def test_a_file_whose_name_is_no_text_has_a_report(place):
    name = os.fsdecode(b"r\xff.ply")
    save_mesh(place / name, ROUGH)
    assert run(["denoise", name, "-o", "o.ply", "--method", "laplacian", "--report", "r.html"]) == 0
    assert "before: r?.ply" in text_of(place / "r.html").lower()
    assert scene_of(place / "r.html")["meshes"][0]["file"] == name


def test_a_result_that_went_to_a_stream_has_no_command_that_makes_it_again(place, monkeypatch):
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(io.BytesIO()))
    assert run(["denoise", "rough.ply", "-o", "-", "--method", "laplacian", "--report", "r.html"]) == 0
    assert "written to a stream" in text_of(place / "r.html") and "Reproduce" not in text_of(place / "r.html")


def test_a_report_never_replaces_a_file_unasked(place):
    (place / "r.html").write_text("mine")
    with pytest.raises(cn.OutputError, match="exists already"):
        cn.report("r.html", ROUGH)
    assert run(["denoise", "rough.ply", "-o", "o.ply", "--method", "laplacian", "--report", "r.html"]) == 5
    assert (place / "r.html").read_text() == "mine" and not (place / "o.ply").exists()
    assert run(["denoise", "rough.ply", "-o", "o.ply", "--truth", "true.ply"]) == 2


@pytest.mark.slow  # a million faces
@pytest.mark.parametrize("with_truth", [False, True])
def test_a_million_faces_take_less_than_twelve_million_bytes(place, with_truth):
    ball = icosphere(8)  # in no regular order
    lowest = np.sort(np.argsort(ball.centroids[:, 2])[:1_000_000])
    used, faces = np.unique(ball.faces[lowest], return_inverse=True)
    clean = Mesh(ball.vertices[used], faces.reshape(-1, 3))
    cn.report("r.html", noisy(clean, 0.2), noisy(clean, 0.02), truth=clean if with_truth else None)
    assert (place / "r.html").stat().st_size < 12e6


@pytest.mark.parametrize(
    ("faces", "said"),
    [("", "points.obj has no faces"), ("f 1 2 2\n", "none of the 1 faces is valid")],
)
def test_a_file_without_a_usable_face_has_a_report_in_text(place, capsys, faces, said):
    (place / "points.obj").write_text(f"v 0 0 0\nv 1 0 0\nv 2 0 0\n{faces}")
    assert run(["inspect", "points.obj"]) == 0
    plain = capsys.readouterr().out
    assert run(["inspect", "points.obj", "--report", "r.html"]) == 0
    assert capsys.readouterr().out == plain + "report: r.html\n"
    text = text_of(place / "r.html")
    assert (
        f"There is nothing to show: {said}" in text
        and hashlib.sha256((place / "points.obj").read_bytes()).hexdigest() in text
    )
    assert 'id="viewer"' not in (place / "r.html").read_text()


def test_a_report_does_not_replace_a_mesh_and_says_which_argument_comes_first(place):
    with pytest.raises(cn.OutputError, match=r"rough\.ply is not the name of an HTML file: end it in \.html"):
        cn.report("rough.ply", "rough.ply", force=True)
    with pytest.raises(
        cn.ParameterError, match="output is of type Mesh; the path of the report comes before the meshes"
    ):
        cn.report(cn.read("rough.ply").mesh, "rough.ply")
