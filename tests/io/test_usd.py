"""USD: each mesh of a layer is moved once; normals and extents follow, everything else stays."""

import io as streams
import re
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from sample_files import PLY_TEXT, read, written
from shapes import grid, icosphere
from usd_layers import SCENE, archive, layer, stored, values, with_attributes

import cascadenorm as cn
from cascadenorm import io
from cascadenorm.cli import run
from cascadenorm.io import files
from cascadenorm.io.files import output_format

pytest.importorskip("pxr")

AGAIN = "double3 xformOp:translate = (0, 5, 0)"
TURN = np.array([(1, 0, 0), (0, 0, 1), (0, -1, 0)])  # z becomes -y


@pytest.mark.parametrize("format", ["usda", "usdc", "usd"])
def test_points_normals_and_extent_are_replaced_and_the_rest_stays(format, tmp_path):
    data = stored(SCENE.encode(), format)
    file = read(data, format)
    assert written(file) == data
    assert file.positions.dtype == np.float32 and len(file.mesh.faces) == 4  # once, though it is shown twice
    moved = b"".join(file.with_vertices(file.mesh.vertices @ TURN.T).pieces())
    assert moved.startswith(b"#usda" if format == "usda" else b"PXR-USDC")
    before, after = layer(data, tmp_path).ExportToString(), layer(moved, tmp_path).ExportToString()
    changed = [new.strip() for old, new in zip(before.splitlines(), after.splitlines(), strict=True) if old != new]
    assert [line.partition(" = ")[0] for line in changed] == [
        "float3[] extent",
        "normal3f[] normals",
        "point3f[] points",
    ]
    roof = values(moved, "/root/roof", tmp_path)
    assert np.array_equal(roof["points"], file.positions @ TURN.T)
    assert np.array_equal(roof["extent"], [(0, 0, -1), (2, 1, 0)])
    half = np.sqrt(0.5)
    expected = np.array([(-half, 0, half), (half, 0, half)]) @ TURN.T
    np.testing.assert_allclose(roof["normals"], expected, atol=1e-6)


def test_normals_of_corners_follow_by_their_indices(tmp_path):
    """Those of a left-handed mesh are on the other side; a mesh that stays keeps its own bit for bit."""
    ball = icosphere(1)
    count, corners = len(ball.vertices), ball.faces.ravel()
    text = "#usda 1.0\n"
    for name, hand, faces in (("a", "rightHanded", ball.faces), ("b", "leftHanded", ball.faces[:, ::-1])):
        text += f"""def Mesh "{name}" {{
            uniform token orientation = "{hand}"
            point3f[] points = {[tuple(row) for row in ball.vertices.tolist()]}
            int[] faceVertexCounts = {[3] * len(faces)}
            int[] faceVertexIndices = {faces.ravel().tolist()}
            normal3f[] primvars:normals = {[tuple(row) for row in ball.vertices.tolist()]} (
                interpolation = "faceVarying"
            )
            int[] primvars:normals:indices = {faces.ravel().tolist()}
        }}
        """
    file = read(text.encode(), "usda")
    assert len(file.mesh.vertices) == 2 * count
    np.testing.assert_allclose(file.mesh.face_normals[: len(ball.faces)], ball.face_normals, atol=1e-6)
    np.testing.assert_allclose(file.mesh.face_normals[len(ball.faces) :], ball.face_normals, atol=1e-6)
    stretched = np.concatenate([ball.vertices, ball.vertices * (1, 2, 3)])
    moved = b"".join(file.with_vertices(stretched).pieces())
    a, b = (values(moved, f"/{name}", tmp_path)["primvars:normals"] for name in "ab")
    assert np.array_equal(a, ball.vertices.astype(np.float32))
    areas = ball.moved(ball.vertices * (1, 2, 3))
    summed = np.zeros((count, 3))
    np.add.at(summed, corners, np.repeat(areas.face_normals * areas.areas[:, None], 3, axis=0))
    expected = summed / np.linalg.norm(summed, axis=1, keepdims=True)
    np.testing.assert_allclose(b, expected, atol=1e-5)


def test_layers_and_textures_of_an_archive_stay(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    root = b"#usda 1.0\n(\n    subLayers = [@parts/roof.usda@]\n)\n"
    (tmp_path / "in.usdz").write_bytes(
        archive({"root.usda": root, "parts/roof.usda": SCENE.encode(), "paint.png": b"p"})
    )
    assert run(["denoise", "in.usdz", "-o", "out.usdz", "--method", "laplacian", "--boundary", "free"]) == 0
    source, found = zipfile.ZipFile("in.usdz"), zipfile.ZipFile("out.usdz")
    assert found.namelist() == source.namelist()
    for name in ("root.usda", "paint.png"):
        assert found.read(name) == source.read(name)
    assert all(entry.compress_type == 0 for entry in found.infolist())
    expected = cn.denoise(cn.read("in.usdz").mesh, method="laplacian").vertices
    points = values(found.read("parts/roof.usda"), "/root/roof", tmp_path)["points"]
    np.testing.assert_allclose(points, expected, atol=1e-6)
    assert cn.read("out.usdz").content().positions.shape == (12, 3)  # composed through the root


def test_other_formats_get_the_scene_as_it_is_shown(tmp_path):
    file = read(SCENE.encode(), "usda")
    content = file.content()
    np.testing.assert_allclose(content.positions[:6], file.positions + np.array((10, 0, 0)))
    np.testing.assert_allclose(content.positions[6:], file.positions + np.array((10, 5, 0)))
    assert content.left_out == ("materials", "the up axis", "the unit", "normals", "the primvar 'st'")
    assert set(content.vertex_values) == set()  # vertex 1 has two texture coordinates
    one_each = SCENE.replace("(0, 0), (1, 0), (1, 1), (0, 1)]", "(1, 0), (2, 0), (2, 1), (1, 1)]")
    found = read(one_each.encode(), "usda").content().vertex_values
    assert found["s"].tolist() == [0, 1, 2, 0, 1, 2] * 2 and found["t"].tolist() == [0, 0, 0, 1, 1, 1] * 2


@pytest.mark.parametrize("format", ["usd", "usda", "usdc", "usdz"])
def test_conversion_keeps_values(format, tmp_path):
    file = read(PLY_TEXT)
    io.write(file, tmp_path / f"a.{format}")
    before, after = file.content(), cn.read(tmp_path / f"a.{format}").content()
    assert np.array_equal(after.positions, before.positions.astype(np.float32))
    assert np.array_equal(after.polygons.corners, before.polygons.corners)
    for found, expected in ((after.vertex_values, before.vertex_values), (after.face_values, before.face_values)):
        assert found.keys() == {name for name in expected if name != "alpha"}
        for name in found:
            assert np.array_equal(found[name], expected[name])


@pytest.mark.parametrize("hides", ['token visibility = "invisible"', 'uniform token purpose = "guide"'])
def test_meshes_that_the_scene_does_not_show_are_left_out(hides):
    for at, count in ((AGAIN, 6), ("double3 xformOp:translate = (10, 0, 0)", 12)):  # one, or all
        content = read(SCENE.replace(at, f"{at}\n{hides}").encode(), "usda").content()
        assert len(content.positions) == count
        assert ("meshes that the scene does not show" in content.left_out) == (count == 6)


def test_values_that_a_conversion_cannot_hold_are_named():
    speed = 'float3[] primvars:speed = [(0, 0, 1)] (interpolation = "constant")'
    left_out = read(with_attributes(speed), "usda").content().left_out
    assert left_out[-3:] == ("normals", "the primvar 'speed'", "the primvar 'st'")  # vertex 1 has two of st


def test_one_colour_of_a_mesh_is_that_of_its_vertices():
    content = read(with_attributes("color3f[] primvars:displayColor = [(1, 0, 0.2)]"), "usda").content()
    assert {name: {*value.tolist()} for name, value in content.vertex_values.items()} == {
        "red": {255},
        "green": {0},
        "blue": {51},
    }


def test_faces_that_are_holes_are_left_out_of_conversions():
    file = read(with_attributes("int[] holeIndices = [0]"), "usda")
    assert len(file.polygons) == 2 and file.content().polygons.corners.tolist() == [1, 2, 5, 4, 7, 8, 11, 10]


def test_proxies_are_shown_without_what_they_stand_for():
    proxy = SCENE.replace(AGAIN, AGAIN + '\nuniform token purpose = "proxy"')
    assert len(read(proxy.encode(), "usda").content().positions) == 12
    both = proxy.replace("float3[] extent", 'uniform token purpose = "render"\nfloat3[] extent')
    assert len(read(both.encode(), "usda").content().positions) == 6


@pytest.mark.parametrize("format", ["vtp", "vtu", "ply", "usda"])
def test_truth_values_and_half_precision_can_be_converted(format, tmp_path):
    pytest.importorskip({"vtp": "vtkmodules", "vtu": "meshio"}.get(format, "numpy"))
    flags = 'bool[] primvars:flag = [1, 0, 0, 1, 0, 1] (interpolation = "vertex")'
    halves = 'half[] primvars:heat = [0.5, 1, 2, 3, 4, 5] (interpolation = "vertex")'
    io.write(read(with_attributes(flags + "\n" + halves), "usda"), tmp_path / f"a.{format}")
    found = cn.read(tmp_path / f"a.{format}").content().vertex_values
    assert found["flag"].tolist() == [1, 0, 0, 1, 0, 1] * 2 and found["heat"].tolist() == [0.5, 1, 2, 3, 4, 5] * 2


def test_values_of_vertices_are_those_of_their_mesh_in_any_order_of_the_scene():
    """The values are the coordinates x, indexed, so that a vertex with the value of another one is seen."""
    ball, text = icosphere(1), "#usda 1.0\n"
    for kind, name, shift in ("class", "a", 0), ("def", "b", 5):
        text += f"""{kind} Mesh "{name}" {{
            point3f[] points = {[tuple(row) for row in (ball.vertices + shift).tolist()]}
            int[] faceVertexCounts = {[3] * len(ball.faces)}
            int[] faceVertexIndices = {ball.faces.ravel().tolist()}
            float[] primvars:weight = {(ball.vertices[::-1, 0] + shift).tolist()} (interpolation = "vertex")
            int[] primvars:weight:indices = {list(range(len(ball.vertices)))[::-1]}
            float primvars:number = 3 (interpolation = "vertex")
            float[] primvars:wide.timeSamples = {{ 1: [1], 2: [2] }}
        }}
"""
    shown = [f'def "{name}" (references = </a>)\n{{\n}}\n' for name in "cd"]
    for scene in "", shown[0], shown[0] + shown[1]:
        file = read((text + scene).encode(), "usda")
        assert {*file.vertex_values} == {"weight"}
        np.testing.assert_array_equal(file.vertex_values["weight"], file.positions[:, 0])
    bad = text.replace("weight:indices = [", "weight:indices = [99, ").replace(", 0]", "]")
    assert "weight" not in read(bad.encode(), "usda").vertex_values


def test_names_of_meshes_are_labels(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.usda").write_text(SCENE)
    assert run(["denoise", "a.usda", "-o", "b.usda", "--only", "mesh=roof", "--method", "laplacian"]) == 0
    assert run(["denoise", "a.usda", "-o", "c.usda", "--only", "mesh=wall", "--method", "laplacian"]) == 2


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("int[] faceVertexCounts = [4, 4]", "int[] faceVertexCounts = [4, 5]"), "faces of /root/roof do not fit"),
        (("point3f[] points", "point3d[] points"), "not of type point3f"),
        (("point3f[] points = [", "point3f[] points.timeSamples = { 1: [(0, 0, 0)], 2: ["), "OpenUSD cannot read"),
        (("def Mesh", "def Cube"), "there is no mesh in this usda file"),
        (("int[] faceVertexCounts = [4, 4]", ""), "has points without faces"),
        (("(0, 0, 0), (1, 0, 1)", "(0, 0, x)"), "OpenUSD cannot read this file: .*(0,|element)"),
        (("#usda 1.0", "#usdb 1.0"), "the file is not USD"),
        (("4, 3, 1", "4, 9, 1"), "1 face uses vertices that do not exist"),
    ],
)
def test_damaged_layers_are_refused(change, words, capfd):
    assert change[0] in SCENE
    with pytest.raises(cn.MeshError, match=words):
        _ = read(SCENE.replace(*change).encode(), "usda").mesh
    assert capfd.readouterr() == ("", "")


@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited on Linux only")
def test_damaged_values_of_binary_layers_are_refused_when_they_are_read(capfd):
    """OpenUSD would allocate and fill as many tokens as a damaged array declares."""
    data = stored(SCENE.encode(), "usdc")
    refused = 0
    for at in range(88, 108):  # the number of entries of the first array
        try:
            read(data[:at] + bytes([data[at] ^ 0x80]) + data[at + 1 :], "usdc")
        except io.ReadError:
            refused += 1
    assert refused
    assert capfd.readouterr().out == ""


def test_damaged_bytes_are_refused(capfd):
    """A message of OpenUSD may show bytes that are no text; sections of a binary layer may run past its end."""
    with pytest.raises(io.ReadError, match="OpenUSD cannot read this file: it is damaged"):
        read(SCENE.encode().replace(b"(1, 0, 1)", b"(1, 0, \xa2)"), "usda")
    data = stored(SCENE.encode(), "usdc")
    table = int.from_bytes(data[16:24], "little")
    for at in (16, table, table + 8 + 16, table + 8 + 24):
        damaged = data[:at] + (5 << 40).to_bytes(8, "little") + data[at + 8 :]
        with pytest.raises(io.ReadError, match="a section of it runs past its end"):
            read(damaged, "usdc")
    for end in (9, 30, len(data) // 2, len(data) - 1):
        with pytest.raises(io.ReadError, match="a section of it runs past its end"):
            read(data[:end], "usdc")
    for row in range(table + 8, len(data) - 31, 32):
        begin = int.from_bytes(data[row + 16 : row + 24], "little")
        for byte in (3, 4, 7):  # of the number of entries
            damaged = data[: begin + byte] + b"\x47" + data[begin + byte + 1 :]
            with pytest.raises(io.ReadError, match="a section of it declares more entries than it can hold"):
                read(damaged, "usdc")
    assert capfd.readouterr().out == ""


def test_messages_about_damaged_binary_layers_name_no_temporary_file():
    data = stored(SCENE.encode(), "usdc")
    said = set()
    for at in range(88, len(data), 9):
        try:
            read(data[:at] + bytes([data[at] ^ 0xFF]) + data[at + 1 :], "usdc")
        except io.ReadError as error:
            said.add(str(error))
    assert any("OpenUSD cannot read this file: Encountered: " in text for text in said)
    assert not [text for text in said if re.search(r"\d\.usd|: $", text)]


@pytest.mark.parametrize(("at", "byte"), [(96, 7), (97, 8)])
def test_a_layer_that_lists_prims_it_does_not_have_is_refused(tmp_path, at, byte):
    """The number of children of the root is damaged; OpenUSD aborts if it is asked for what they refer to."""
    ball = io.from_arrays(icosphere(1).vertices.astype(np.float32), icosphere(1).faces)
    whole = streams.BytesIO()
    io.write(ball, whole, format="usdc")
    data = bytearray(whole.getvalue())
    data[at] = byte
    (tmp_path / "bad.usdc").write_bytes(data)
    command = [sys.executable, "-m", "cascadenorm", "inspect", str(tmp_path / "bad.usdc")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 3 and "there is no mesh in this usdc file" in done.stderr


@pytest.mark.parametrize(
    "text", ['#usda 1.0\ndef Mesh "m" {\n int[] faceVertexCounts = [3', "#usda 9.0\n\n", "#usda 1.0\n("]
)
def test_messages_about_text_name_its_lines_and_no_temporary_file(text):
    with pytest.raises(io.ReadError, match=r"OpenUSD cannot read this file: line \d+, column \d+: ") as caught:
        read(text.encode(), "usda")
    assert "/" not in str(caught.value).partition(" in <")[0] and "::" not in str(caught.value)


def test_animated_points_are_refused():
    points = re.search(r"point3f\[\] points = (\[.*\])", SCENE)
    frames = f"point3f[] points.timeSamples = {{ 1: {points[1]}, 2: {points[1]} }}"
    with pytest.raises(io.ReadError, match=r"/root/roof\.points is animated: export a single frame"):
        read(SCENE.replace(points[0], frames).encode(), "usda")
    one = read(SCENE.replace(points[0], f"point3f[] points.timeSamples = {{ 7: {points[1]} }}").encode(), "usda")
    again = read(b"".join(one.with_vertices(one.mesh.vertices + 1).pieces()), "usda")
    assert np.array_equal(again.positions, one.positions + 1)


@pytest.mark.parametrize("path", ["../secret.usda", "/etc/secret.usda"])
def test_nothing_outside_the_file_is_read(path, tmp_path, monkeypatch):
    folder = tmp_path / "in"
    folder.mkdir()
    secret = tmp_path / "secret.usda"
    secret.write_text(SCENE)
    path = str(secret) if path.startswith("/") else path
    text = SCENE.replace("references = </root/roof>", f"references = @{path}@")
    (folder / "a.usda").write_text(text)
    file = cn.read(folder / "a.usda")
    assert len(file.content().positions) == 6
    assert f"the file {path!r} that it references" in file.content().left_out
    only = f'#usda 1.0\ndef "a" (references = @{path}@) {{}}\n'
    with pytest.raises(io.ReadError, match=f"there is no mesh in this usda file; it references {re.escape(path)}"):
        read(only.encode(), "usda")
    for name in ("../evil.usda", "/evil.usda"):
        with pytest.raises(io.ReadError, match="outside the archive"):
            read(archive({"a.usda": SCENE.encode(), name: b""}), "usdz")


def test_scenes_that_copy_themselves_are_refused(monkeypatch):
    """Each of 30 objects references the one before twice: a thousand million meshes."""
    text = SCENE
    for level in range(30):
        before = f"/level{level - 1}" if level else "/root/roof"
        parts = "".join(f'def "{half}" (references = <{before}>) {{}}\n' for half in "ab")
        text += f'def "level{level}" {{\n{parts}}}\n'
    file = read(text.encode(), "usda")
    assert len(file.mesh.faces) == 4
    with pytest.raises(io.ReadError, match="the objects of this scene need"):
        file.content()


def test_meshes_of_all_variants_are_moved_and_the_selected_one_is_shown():
    mesh = """{{
            def Mesh "m"
            {{
                int[] faceVertexCounts = [3]
                int[] faceVertexIndices = [0, 1, 2]
                point3f[] points = [(0, 0, 0), ({}, 0, 0), (0, 1, 0)]
            }}
        }}"""
    text = f"""#usda 1.0
def Xform "a" (
    variants = {{ string size = "large" }}
    prepend variantSets = "size"
)
{{
    variantSet "size" = {{
        "small" {mesh.format(1)}
        "large" {mesh.format(2)}
    }}
}}
"""
    file = read(text.encode(), "usda")
    assert file.positions[[1, 4], 0].tolist() == [1, 2]
    moved = read(b"".join(file.with_vertices(file.mesh.vertices * 3).pieces()), "usda")
    assert sorted(moved.positions[[1, 4], 0].tolist()) == [3, 6]  # OpenUSD sorts variants by their names
    assert moved.content().positions[:, 0].tolist() == [0, 6, 0]


def test_the_extra_is_named(monkeypatch):
    monkeypatch.setattr(files, "is_installed", lambda module: module != "pxr")
    for format in ("usd", "usda", "usdc", "usdz"):
        words = re.escape(f"'{format}' files needs usd-core, which is not installed: pip install \"cascadenorm[usd]\"")
        with pytest.raises(cn.MissingDependencyError, match=words):
            read(b"anything", format)
        with pytest.raises(cn.MissingDependencyError, match=words):
            output_format(f"a.{format}")


def test_a_stream_is_recognised_by_its_first_bytes():
    assert read(SCENE.encode()).format == "usda" and read(stored(SCENE.encode(), "usdc")).format == "usdc"
    packed = archive({"a.usda": SCENE.encode()})
    assert read(packed).format == "usdz"
    with pytest.raises(io.ReadError, match="the content is not a supported mesh format"):
        read(packed[:-30])  # without its list of files


def test_large_grids_are_read_and_written(tmp_path):
    sheet = grid(30, 40)
    io.write(io.from_arrays(sheet.vertices, sheet.faces), tmp_path / "a.usdz")
    assert np.array_equal(cn.read(tmp_path / "a.usdz").mesh.faces, sheet.faces)
    with zipfile.ZipFile(tmp_path / "a.usdz") as entries:
        (entry,) = entries.infolist()
    assert entry.date_time[:3] == (1980, 1, 2)  # the bytes depend on the mesh only
    with (tmp_path / "a.usdz").open("rb") as file:
        file.seek(entry.header_offset + 26)
        name, extra = np.frombuffer(file.read(4), "<u2")
        assert (entry.header_offset + 30 + int(name) + int(extra)) % 64 == 0  # as USDZ demands
