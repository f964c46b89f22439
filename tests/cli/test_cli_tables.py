"""Results are printed in full, with advice that the command can follow."""

import json

import numpy as np
from commands import FAST
from shapes import grid

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import Mesh


def test_vertices_that_nearly_coincide_are_named_and_how_to_join_them_if_the_command_can(place, capsys):
    sheet = grid(6, 6)
    right = sheet.centroids[:, 0] > 3
    vertices = np.concatenate([sheet.vertices, sheet.vertices + 1e-5])
    save_mesh(place / "seam.ply", Mesh(vertices, np.where(right[:, None], sheet.faces + 49, sheet.faces)))
    said = "7 boundary vertices lie within 0.001 edges of another one, but not joined with it"
    assert run(["denoise", "seam.ply", *FAST]) == 0
    assert f"{said}: --weld '0.001 edges' joins them\n" in capsys.readouterr().err
    assert run(["denoise-regions", "seam.ply", *FAST, "--force"]) == 0
    assert f"{said}\n" in capsys.readouterr().err


def test_methods_lists_every_method_and_its_parameters(capsys):
    assert run(["methods", "--json"]) == 0
    found = {method["name"]: method for method in json.loads(capsys.readouterr().out)["methods"]}
    assert set(found) == set(cn.methods())
    names = {parameter["name"] for parameter in found["laplacian"]["parameters"]}
    assert names == set(cn.methods()["laplacian"].settings) - {"region"}
    assert run(["methods"]) == 0
    assert all(name in capsys.readouterr().out for name in ["laplacian"])
    assert run(["methods", "bilateral-normal"]) == 0
    out = capsys.readouterr().out
    assert "Zheng" in out and "sigma_r" in out and "mean edge lengths" in out
