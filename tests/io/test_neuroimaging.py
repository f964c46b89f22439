"""Surfaces of FreeSurfer and GIFTI keep what they hold besides positions."""

import numpy as np
import pytest
from sample_files import PLY_TEXT, read, written
from shapes import icosphere

import cascadenorm as cn
from cascadenorm import io
from cascadenorm.cli import run


def test_freesurfer_surfaces_keep_every_byte_but_positions(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ball = icosphere(2)
    head = b"\xff\xff\xfecreated by someone\n\n" + np.array([162, 320], ">i4").tobytes()
    rest = ball.faces.astype(">i4").tobytes() + b"volume geometry"
    data = head + ball.vertices.astype(">f4").tobytes() + rest
    (tmp_path / "lh.pial").write_bytes(data)
    assert written(cn.read("lh.pial")) == data
    assert run(["denoise", "lh.pial", "-o", "lh.white", "--method", "laplacian"]) == 0
    expected = cn.denoise(ball.vertices.astype(np.float32), ball.faces, method="laplacian")
    assert (tmp_path / "lh.white").read_bytes() == head + expected.astype(">f4").tobytes() + rest
    io.write(cn.read("lh.pial"), "ball.ply")
    io.write(cn.read("ball.ply"), "rh.pial")
    assert np.array_equal(cn.read("rh.pial").mesh.faces, ball.faces)
    for cut in (3, 20, len(head) + 3, len(data) - len(b"volume geometry") - 1):
        with pytest.raises(io.ReadError, match="truncated"):
            read(data[:cut], "freesurfer")


@pytest.mark.parametrize("number", ["99999999999", "0", "x"])
def test_gifti_arrays_of_an_impossible_dimension_are_refused_at_once(number):
    pytest.importorskip("nibabel")
    with pytest.raises(io.ReadError, match=f'Dimensionality="{number}" in this gii file is none of 1 to 6'):
        read(f'<GIFTI><DataArray Dimensionality="{number}" Dim0="3"></DataArray></GIFTI>'.encode(), "gii")


def test_gifti_surfaces_keep_their_other_arrays(tmp_path):
    nibabel = pytest.importorskip("nibabel")
    ball, gifti = icosphere(2), nibabel.gifti
    points = gifti.GiftiDataArray(
        ball.vertices.astype(np.float32), intent="NIFTI_INTENT_POINTSET", datatype="NIFTI_TYPE_FLOAT32"
    )
    triangles = gifti.GiftiDataArray(ball.faces, intent="NIFTI_INTENT_TRIANGLE", datatype="NIFTI_TYPE_INT32")
    heat = np.arange(162, dtype=np.float32)
    values = gifti.GiftiDataArray(heat, intent="NIFTI_INTENT_SHAPE", datatype="NIFTI_TYPE_FLOAT32")
    path = tmp_path / "lh.pial.surf.gii"
    gifti.GiftiImage(darrays=[points, triangles, values]).to_filename(path)
    file = cn.read(path)
    assert written(file) == path.read_bytes()
    moved = tmp_path / "moved.gii"
    assert io.write(file.with_vertices(file.mesh.vertices * 2), moved) == list(file.moving_loses)
    found = nibabel.load(moved)
    assert np.array_equal(found.darrays[0].data, ball.vertices.astype(np.float32) * 2)
    assert np.array_equal(found.darrays[1].data, ball.faces) and np.array_equal(found.darrays[2].data, heat)
    io.write(read(PLY_TEXT), tmp_path / "made.gii")
    assert np.array_equal(cn.read(tmp_path / "made.gii").mesh.faces, read(PLY_TEXT).mesh.faces)
    for content in (b"<GIFTI>", b"<GIFTI", path.read_bytes()[:-500]):
        with pytest.raises(io.ReadError, match="nibabel cannot read this as gii"):
            read(content, "gii")
