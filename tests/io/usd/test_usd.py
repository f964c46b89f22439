"""USD: each mesh of a layer is moved once; normals and extents follow, everything else stays."""

import re

import numpy as np
import pytest
from sample_files import read, written
from shapes import icosphere
from usd_layers import SCENE, archive, layer, stored, values

import cascadenorm as cn
from cascadenorm import io
from cascadenorm.cli import run
from cascadenorm.io import files
from cascadenorm.io.files import output_format

pytest.importorskip("pxr")

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
