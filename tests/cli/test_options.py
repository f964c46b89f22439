"""Options set the controls and parameters of their names, and messages name them."""

import numpy as np
from commands import FAST, ROUGH, refused
from shapes import grid, noisy

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.cli.options import OTHER_OPTIONS
from cascadenorm.io.interop import save_mesh


def test_arguments_are_named_as_options_and_parameters_of_methods_are_not(place, capsys):
    assert not OTHER_OPTIONS & {name for method in cn.methods().values() for name in method.settings}
    for arguments, told in (
        ("render ball.ply -o a.png --values bogus", "--values is 'bogus'; it must be one of angle, "),
        ("batch ball.ply -o out --memory much", "--memory is 'much'"),
        (f"denoise ball.ply --memory {'9' * 400}GB", "--memory is '99"),
        ("denoise ball.ply --scheduler local", "--scheduler works on patches"),
        (
            "denoise ball.ply --method fairing",
            "fairing needs a region: denoise with a mask of the vertices",
        ),
        ("train --quick --threads 0 -o w.safetensors", "--threads is 0; it must be at least 1\n"),
        ("train-gate ball.ply ball.ply --threads 0 -o w.safetensors", "--threads is 0; it must be at least 1\n"),
        ("denoise ball.ply --method laplacian --set iterations=-1", "iterations is -1"),
    ):
        code, message = refused(capsys, *arguments.split())
        assert code == 2 and message.startswith(f"cascadenorm: {told}")


def test_options_reach_the_method_and_its_controls(place):
    options = ["--set", "iterations=2", "--set", "step=0.3", "--strength", "1.5", "--keep-volume", "--threads", "1"]
    assert run(["denoise", "ball.ply", "-o", "out.ply", *FAST, *options, "--max-displacement", "0.3 edges"]) == 0
    expected = cn.denoise(
        ROUGH, method="laplacian", iterations=2, step=0.3, strength=1.5, volume="keep", max_displacement="0.3 edges"
    )
    np.testing.assert_array_equal(cn.read("out.ply").mesh.vertices, expected.vertices)


def test_boundaries_and_detail_reach_the_controls(place, capsys):
    sheet = noisy(grid(4, 4), 0.1)
    save_mesh(place / "sheet.ply", sheet)
    options = ["--boundary", "smooth", "--keep-detail", "2 edges"]
    assert run(["denoise", "sheet.ply", "-o", "out.ply", *FAST, *options]) == 0
    expected = cn.denoise(sheet, method="laplacian", boundary="smooth", keep_detail="2 edges").vertices
    np.testing.assert_array_equal(cn.read("out.ply").mesh.vertices, expected)
    capsys.readouterr()
    code, message = refused(capsys, "denoise", "sheet.ply", *FAST, "--boundary", "open")
    assert code == 2 and "must be one of free, smooth, fixed" in message


def test_regions_and_creases_are_said_in_words(place, capsys):
    corners = "\n".join(f"{a} {b} 0" for a, b in ((0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (2, 1)))
    faces = "usemtl a\nf 1 2 3\nf 2 4 3\nusemtl b\nf 2 5 4\nf 5 6 4\n"
    (place / "two.obj").write_text("v " + corners.replace("\n", "\nv ") + "\n" + faces)
    np.save(place / "mask.npy", np.ones(6))
    words = ["--mask", "mask.npy", "--fixed", "0", "--only", "a", "--only", "b", "--creases", "80"]
    assert run(["denoise", "two.obj", "-o", "out.obj", *FAST, *words]) == 0
    mesh = cn.read("two.obj").mesh
    expected = cn.denoise(mesh, method="laplacian", fixed=[0]).vertices
    np.testing.assert_allclose(cn.read("out.obj").mesh.vertices, expected, atol=1e-12)
    capsys.readouterr()
    code, message = refused(capsys, "denoise", "two.obj", *FAST, "--only", "c")
    assert code == 2 and "--only matches no face with 'c'; there are: material=a, material=b" in message
