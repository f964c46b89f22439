"""Patches of one mesh denoised on a Dask cluster: the bytes of this machine, whatever happens to the workers."""

import os
from pathlib import Path

import pytest
from shapes import icosphere, noisy
from test_batch import LINUX
from test_cluster_processes import cluster  # noqa: F401 - a fixture
from test_stages import RIBBON
from test_streaming import NORMALS

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.io.interop import save_mesh
from cascadenorm.streaming import ply_rows, streaming
from cascadenorm.streaming.patch_files import write_missing


@pytest.fixture
def place(tmp_path, monkeypatch) -> Path:
    """A folder, in which files of some thousand faces are large."""
    monkeypatch.setattr(streaming, "SMALLEST", 600)
    monkeypatch.setattr(ply_rows, "BLOCK", 1000)
    return tmp_path


def killing(process, *fractions):
    """A progress that kills a worker once such a fraction of the work is done."""
    left = list(fractions)

    def progress(fraction):
        if left and fraction >= left[0]:
            left.pop(0)
            process.stdin.write("\n")
            process.stdin.flush()

    progress.left = left
    return progress


@LINUX
@pytest.mark.parametrize(
    "settings",
    [NORMALS, {"method": "auto"}, {"method": "guided-normal", "parameters": {"iterations": 2, "sweeps": 4}}],
    ids=["bilateral-normal", "auto", "guided-normal"],
)
def test_workers_killed_at_random_moments_change_no_byte(place, cluster, settings):  # noqa: F811
    address, process = cluster
    save_mesh(place / "scan.ply", RIBBON if settings["method"] == "auto" else noisy(icosphere(5), 0.2))
    here = cn.denoise_large_file(place / "scan.ply", place / "here.ply", memory=1, **settings)
    progress = killing(process, 0.1, 0.4, 0.7)
    there = cn.denoise_large_file(
        place / "scan.ply", place / "there.ply", memory=1, scheduler=address, progress=progress, **settings
    )
    assert not progress.left
    assert (place / "there.ply").read_bytes() == (place / "here.ply").read_bytes()
    assert (there.moved, there.mean_displacement) == (here.moved, here.mean_displacement)
    assert sorted(os.listdir(place)) == ["here.ply", "scan.ply", "there.ply"]


def test_a_cluster_goes_on_where_one_machine_was_interrupted(place, cluster):  # noqa: F811
    save_mesh(place / "scan.ply", noisy(icosphere(5), 0.2))
    seen = []

    def interrupted(fraction):
        seen.append(fraction)
        if len(seen) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cn.denoise_large_file(place / "scan.ply", place / "out.ply", memory=1, **NORMALS, progress=interrupted)
    folder = place / ".out.ply.parts"
    kept = {path.name: path.stat().st_mtime_ns for path in folder.glob("patch_*.bin")}
    found = []

    def noted(fraction):
        found.append({name: (folder / name).stat().st_mtime_ns for name in kept})

    cn.denoise_large_file(
        place / "scan.ply", place / "out.ply", memory=1, scheduler=cluster[0], progress=noted, **NORMALS
    )
    assert len(kept) == 3 and found and all(times == kept for times in found)
    cn.denoise_file(place / "scan.ply", place / "whole.ply", **NORMALS)
    assert (place / "out.ply").read_bytes() == (place / "whole.ply").read_bytes()


def test_what_a_cluster_needs_is_said(place, cluster, capsys, monkeypatch):  # noqa: F811
    save_mesh(place / "scan.ply", icosphere(4))
    monkeypatch.chdir(place)
    words = ["denoise", "scan.ply", "-o", "out.ply", "--method", "taubin", "--scheduler", cluster[0]]
    assert run(words) == 2
    assert "--scheduler works on patches: give --memory too, that of a worker" in capsys.readouterr().err
    assert run([*words, "--memory", "1MB"]) == 1
    said = capsys.readouterr().err
    assert "where relative names mean others: give absolute ones" in said and len(said.splitlines()) == 1
    with pytest.raises(cn.WorkerError, match=r"a worker does not find .*nowhere: the folder of the output has to have"):
        list(write_missing([place / "nowhere" / "patch_0.bin"], lambda number: b"", map))
