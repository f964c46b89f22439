"""What is kept of an evaluation, so that another goes on there."""

import importlib
import shutil
import subprocess
import sys
import time
from typing import Annotated

import pytest
from evaluated import SHAPES, python
from shapes import icosphere

from cascadenorm.batch.work import batch_settings
from cascadenorm.cli import run
from cascadenorm.errors import ParameterError
from cascadenorm.evaluation.harness import evaluate
from cascadenorm.io.interop import save_mesh
from cascadenorm.registry import Parameter
from cascadenorm.registry import methods as registry


def counted_method(monkeypatch):
    calls = []

    def counted(mesh):
        calls.append(len(mesh.faces))
        return mesh.vertices.copy()

    monkeypatch.setitem(registry._methods, "counted", registry.Method("counted", counted, "", {}))
    return calls


def test_what_was_kept_is_not_computed_again(folder, tmp_path, monkeypatch):
    calls = counted_method(monkeypatch)
    first = evaluate(folder, methods="counted", keep=tmp_path / "kept")
    assert calls
    calls.clear()
    assert evaluate(folder, methods="counted", keep=tmp_path / "kept").results == first.results
    assert calls == []
    evaluate(folder, methods="counted", strength=0.5, keep=tmp_path / "kept")
    assert calls  # another setting
    pair = shutil.copytree(folder, tmp_path / "pairs")
    calls.clear()
    evaluate(pair, methods="counted", strength=0.5, keep=tmp_path / "kept")
    assert calls == []  # the same files elsewhere
    save_mesh(pair / "ball" / "clean.ply", icosphere(3), force=True)
    evaluate(pair, methods="counted", strength=0.5, keep=tmp_path / "kept")
    assert len(SHAPES["ball"].faces) in calls and len(SHAPES["cube"].faces) not in calls


def test_a_mesh_that_was_lost_is_made_again(folder, tmp_path, monkeypatch):
    calls = counted_method(monkeypatch)
    evaluate(folder / "ball", methods="counted", keep=tmp_path)
    calls.clear()
    (tmp_path / "ball" / "counted.ply").unlink()
    evaluate(folder / "ball", methods="counted", keep=tmp_path)
    assert calls and (tmp_path / "ball" / "counted.ply").exists()


def test_a_model_of_a_method_of_ones_own_is_no_weights_file_of_this_package(folder, tmp_path, monkeypatch):
    def mine(mesh, *, model: Annotated[str | None, Parameter("my network")] = None):
        return mesh.vertices.copy()

    method = registry.Method("mine", mine, "", registry._settings(mine))
    monkeypatch.setitem(registry._methods, "mine", method)
    for parameters in ({}, {"model": "anything"}):
        assert not evaluate(folder, methods="mine", parameters=parameters, keep=tmp_path / "kept").failures
        batch_settings("mine", parameters, {}, None, force=False)  # raises nothing


def test_the_folder_of_the_pairs_is_refused_since_their_noisy_meshes_would_be_overwritten(folder, tmp_path):
    pairs = shutil.copytree(folder, tmp_path / "pairs")
    before = sorted(pairs.rglob("*"))
    for given in (pairs, pairs / "ball"):
        with pytest.raises(ParameterError, match=r"keep is .*, the folder of the pair ball"):
            evaluate(given, methods="taubin", keep=pairs)
    assert sorted(pairs.rglob("*")) == before


METHOD = """
from own_helper import FACTOR

def shifted(mesh):
    return mesh.vertices * FACTOR
"""


@pytest.mark.parametrize("changed", ["own_method", "own_helper"])
def test_a_method_of_ones_own_is_run_again_when_its_source_has_changed(folder, tmp_path, monkeypatch, changed):
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # that of a source changed within a second would be taken

    def measured(factor, method=METHOD):
        (tmp_path / "own_method.py").write_text(method)
        (tmp_path / "own_helper.py").write_text(f"FACTOR = {factor}\n")
        importlib.invalidate_caches()
        for name in ("own_method", "own_helper"):
            monkeypatch.delitem(sys.modules, name, raising=False)
        shifted = importlib.import_module("own_method").shifted
        monkeypatch.setitem(registry._methods, "shifted", registry.Method("shifted", shifted, "", {}))
        done = evaluate(folder / "ball", methods="shifted", keep=tmp_path / "kept")
        kept = tmp_path / "kept" / "ball" / "shifted.json"
        return done.results[-1].measures.vertex_error_edges, kept.stat().st_mtime_ns

    first, same = measured(1.0), measured(1.0)
    assert same == first
    after = measured(1.5) if changed == "own_helper" else measured(1.0, METHOD.replace("* FACTOR", "* 1.5"))
    assert after[0] > first[0] and after[1] != first[1]


def test_a_killed_evaluation_goes_on(folder, tmp_path):
    go = tmp_path / "go"
    waiting = f"""
import os, shutil, sys, time
while 'cube' in sys.argv[1] and not os.path.exists({str(go)!r}):
    time.sleep(0.02)
shutil.copyfile(*sys.argv[1:])
"""
    slow = python(waiting)
    arguments = ["evaluate", str(folder), "--method", "laplacian", "--command", f"slow={slow}", "--keep", str(tmp_path)]
    process = subprocess.Popen([sys.executable, "-m", "cascadenorm", *arguments], stderr=subprocess.DEVNULL)
    while not (tmp_path / "cube" / "laplacian.json").exists():
        assert process.poll() is None
        time.sleep(0.05)
    process.kill()
    process.wait()
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")}
    assert len(kept) == 5 and not (tmp_path / "cube" / "slow.json").exists()
    go.touch()
    assert run([*arguments, "--json"]) == 0
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in kept.items())
    assert (tmp_path / "cube" / "slow.json").exists()
