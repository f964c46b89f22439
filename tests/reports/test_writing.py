"""A report says what there is to say of any mesh, and never replaces a file unasked."""

import hashlib
import io
import os
import re
import sys

import numpy as np
import pytest
from report_contents import CLEAN, ROUGH, scene_of, text_of

import cascadenorm as cn
from cascadenorm.api.api import denoise_file_with_meshes
from cascadenorm.cli import run
from cascadenorm.io.content import Content
from cascadenorm.io.interop import save_mesh
from cascadenorm.io.ply.ply import PlyFile
from cascadenorm.mesh import Mesh
from cascadenorm.mesh.polygons import Polygons
from cascadenorm.reports import report_denoised


def test_settings_that_were_changed_are_shown_and_the_others_folded(place):
    report_denoised("r.html", denoise_file_with_meshes("rough.ply", "out.ply", method="taubin", strength=0.5))
    page = (place / "r.html").read_text()
    shown, fold = re.search(r"<h2>Method and settings</h2>(.*?)<details>(.*?)</details>", page, re.S).groups()
    rows = [re.findall(r'<th scope="row">(.*?)</th>', part) for part in (shown, fold)]
    assert rows[0] == ["strength"] and {"iterations", "boundary", "on_bad"} <= set(rows[1])
    assert f"<summary>{len(rows[1])} settings have their defaults</summary>" in fold


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
