"""Patches are as large as the memory allows, and are used where a mesh does not fit."""

from pathlib import Path

import pytest
from batches import LINUX
from patched import AGREES, BALL, EXACT, RIBBON

import cascadenorm as cn
from cascadenorm.api import patch_sizes
from cascadenorm.cli import run
from cascadenorm.io.interop import save_mesh

FEW = {"MIN_PATCH_FACES": 900, "MAX_PATCH_FACES": 900, "PROCESS_BYTES": 0, "WHOLE_FACE_BYTES": 1, "PATCH_FACE_BYTES": 1}


@pytest.fixture
def place(tmp_path, monkeypatch) -> Path:
    """A working directory in which a mesh of some thousand faces is large, so that 6 kB hold patches of 900 faces."""
    monkeypatch.chdir(tmp_path)
    for name, value in FEW.items():
        monkeypatch.setattr(patch_sizes, name, value)
    return tmp_path


@pytest.mark.parametrize("suffix", ["ply", "stl", "obj", "off", "glb"])
def test_every_format_is_denoised_in_patches(place, suffix):
    save_mesh(place / f"scan.{suffix}", BALL)
    given = {"method": "bilateral-normal", "parameters": {"iterations": 3}}
    whole = cn.denoise_file(f"scan.{suffix}", f"whole.{suffix}", **given)
    patches = cn.denoise_file(f"scan.{suffix}", f"patches.{suffix}", memory=6500, **given)
    assert (place / f"patches.{suffix}").read_bytes() == (place / f"whole.{suffix}").read_bytes()
    assert (patches.moved, patches.faces) == (whole.moved, whole.faces)


def test_memory_on_the_command_line(place, capsys):
    save_mesh(place / "scan.ply", BALL)
    words = ["denoise", "scan.ply", "--method", "mean-normal"]
    assert run([*words, "-o", "whole.ply"]) == run([*words, "-o", "patches.ply", "--memory", "6500 B"]) == 0
    assert (place / "patches.ply").read_bytes() == (place / "whole.ply").read_bytes()
    assert run([*words, "-o", "a.ply", "--memory", "5 kB"]) == 2
    assert "memory is 5,000 bytes; 5,120 faces need at least 6,020 bytes" in capsys.readouterr().err
    assert run([*words, "-o", "a.ply", "--memory", "much"]) == 2
    assert "memory is 'much'; it must be an amount of memory" in capsys.readouterr().err
    assert run(["denoise", "scan.ply", "-o", "a.ply", "--method", "fairing", "--memory", "1GB"]) == 2
    message = capsys.readouterr().err
    assert "fairing needs the whole mesh at once" in message and "set no limit of memory if" in message
    assert run([*words, "-o", "a.ply", "--scheduler", "local"]) == 2
    assert "--scheduler works on patches, which fit into the memory of a worker: pass --memory\n" in (
        capsys.readouterr().err
    )


def test_a_mesh_that_does_not_fit_is_denoised_in_patches_and_that_is_said(place, capsys, monkeypatch):
    from cascadenorm.api import api

    save_mesh(place / "scan.ply", BALL)
    monkeypatch.setattr(api, "free_memory", lambda: 8500)
    assert run(["denoise", "scan.ply", "-o", "out.ply", "--method", "taubin"]) == 0
    said = capsys.readouterr().err
    assert "taubin needs about 3 MB for 5,120 faces, and 8,500 bytes are free: it is denoised in patches" in said


def test_which_methods_work_in_patches():
    def works(name, **given):
        return patch_sizes.works_in_patches(cn.methods()[name], given)

    assert works("auto") and works("cascade") and works("guided-normal") and all(map(works, EXACT))
    assert not works("guided-normal", fit="least-squares") and not works("bilateral-normal", fit="least-squares")
    assert not works("laplacian", scheme="implicit") and not works("fairing") and not works("tv-normal")


@LINUX
@pytest.mark.parametrize(
    "method",
    ["bilateral-normal", pytest.param("auto", marks=pytest.mark.slow)],  # each worker loads the weights
)
def test_workers_give_the_result_of_this_process(place, cluster, method, monkeypatch):
    monkeypatch.setattr(patch_sizes, "MAX_PATCH_FACES", 2400)
    save_mesh(place / "scan.ply", RIBBON if method == "auto" else BALL)
    whole = cn.denoise_file("scan.ply", "whole.ply", method=method)
    there = cn.denoise_file("scan.ply", "there.ply", method=method, memory=2500, scheduler=cluster[0])
    assert there.moved == whole.moved
    one, other = cn.read("whole.ply").mesh, cn.read("there.ply").mesh
    assert abs(one.vertices - other.vertices).max() < AGREES * one.mean_edge_length
