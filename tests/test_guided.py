"""`guided-normal` in patches on disk: the answer that it gives in memory."""

import os

import numpy as np
import pytest
from shapes import noisy
from test_stages import AGREES, RIBBON, SHAPES, difference, patch_sizes, place

import cascadenorm as cn
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import Mesh
from cascadenorm.streaming import guided, sweeps

__all__ = ["place"]  # a fixture

PATCH = {"iterations": 3, "sweeps": 4}
GAUSSIAN = {"guidance": "gaussian", "iterations": 2, "sweeps": 2}
CASES = {
    **{name: (shape, PATCH) for name, shape in SHAPES.items()},
    "gaussian": (SHAPES["ribbon"], GAUSSIAN),
    "given distances": (SHAPES["ribbon"], {**PATCH, "radius": 1.5, "sigma_s": 0.8, "sigma_r": 0.3}),
    "no sweeps": (SHAPES["ribbon"], {"iterations": 2, "sweeps": 0}),
    "no passes": (SHAPES["ribbon"], {"iterations": 0}),
}


@pytest.mark.parametrize("name", CASES)
def test_patches_agree_with_memory(place, name, monkeypatch):
    shape, parameters = CASES[name]
    mesh = shape()
    monkeypatch.setattr(sweeps, "WIDTH", 30)  # sweeps in several passes
    save_mesh("scan.ply", mesh)
    given = {"method": "guided-normal", "parameters": parameters, "strength": 0.9}
    expected = cn.denoise_file("scan.ply", "whole.ply", **given)
    patches = patch_sizes(monkeypatch)
    done = cn.denoise_large_file("scan.ply", "parts.ply", memory=1, **given)
    assert difference("parts.ply", "whole.ply") < AGREES
    assert max(patches) < 0.8 * len(mesh.vertices)
    assert done.mean_displacement == pytest.approx(expected.mean_displacement, rel=1e-6)
    assert sorted(os.listdir()) == ["parts.ply", "scan.ply", "whole.ply"]


@pytest.mark.parametrize("parameters", [PATCH, GAUSSIAN], ids=["patch", "gaussian"])
def test_a_halo_that_the_neighbourhoods_leave_is_widened(place, monkeypatch, parameters):
    """Tiny faces, of which many lie within the radius, and a halo of one edge to begin with."""
    x, y, z = RIBBON.vertices.T
    fine = Mesh(np.stack([x, np.where(y > 250, 250 + 0.1 * (y - 250), y), z], axis=1), RIBBON.faces)
    monkeypatch.setattr(guided, "RINGS", 1)
    save_mesh("scan.ply", noisy(fine, 0.1))
    cn.denoise_file("scan.ply", "whole.ply", method="guided-normal", parameters=parameters)
    cn.denoise_large_file("scan.ply", "parts.ply", memory=1, method="guided-normal", parameters=parameters)
    assert difference("parts.ply", "whole.ply") < AGREES


def test_an_interrupted_run_goes_on_with_the_next_patch_of_its_pass(place):
    save_mesh("scan.ply", RIBBON)
    given = {"memory": 1, "method": "guided-normal", "parameters": PATCH}
    cn.denoise_large_file("scan.ply", "expected.ply", **given)
    folder, fractions, seen = place / ".out.ply.parts", [], {}

    def interrupted(fraction):
        fractions.append(fraction)
        if fraction > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cn.denoise_large_file("scan.ply", "out.ply", **given, progress=interrupted)
    kept = {path.name: path.stat().st_mtime_ns for path in folder.glob("pass_*.npz")}
    assert kept

    def noted(fraction):
        fractions.append(fraction)
        seen.update({name: (folder / name).stat().st_mtime_ns for name in kept if folder.exists()})

    fractions.clear()
    cn.denoise_large_file("scan.ply", "out.ply", **given, progress=noted)
    assert seen == kept  # none of them was done again
    assert (place / "out.ply").read_bytes() == (place / "expected.ply").read_bytes()
    assert fractions == sorted(fractions) and fractions[-1] == 1.0


def test_least_squares_are_refused(place):
    save_mesh("scan.ply", RIBBON)
    given = {"memory": 1, "method": "guided-normal", "parameters": {"fit": "least-squares"}}
    with pytest.raises(cn.ParameterError, match="fit is 'least-squares', which solves a system of all vertices"):
        cn.denoise_large_file("scan.ply", "parts.ply", **given)
    assert os.listdir() == ["scan.ply"]
