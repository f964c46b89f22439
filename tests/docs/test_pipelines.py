"""The examples for pipelines run, and what describes the project to other tools agrees with it."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from shapes import icosphere, noisy

import cascadenorm as cn
from cascadenorm.io.interop import save_mesh

ROOT = Path(__file__).parents[2]
BALL = noisy(icosphere(2), 0.2)
PROGRAM = f'#!/bin/sh\nexec "{sys.executable}" -m cascadenorm "$@"\n'


@pytest.fixture
def scans(tmp_path):
    """A folder with two scans, the truth of one, the examples, and the program on the search path."""
    for name in ("scans", "truth", "programs"):
        (tmp_path / name).mkdir()
    for name in ("a", "b"):
        save_mesh(tmp_path / "scans" / f"{name}.ply", BALL)
    save_mesh(tmp_path / "truth" / "a.ply", icosphere(2))
    for name in ("Makefile", "Snakefile"):
        shutil.copy(ROOT / "examples" / name, tmp_path)
    program = tmp_path / "programs" / "cascadenorm"
    program.write_text(PROGRAM)
    program.chmod(0o755)
    return tmp_path


def ran(folder, *words, **variables):
    path = os.pathsep.join([str(folder / "programs"), os.environ["PATH"]])
    environment = {**os.environ, "PATH": path, **variables}
    return subprocess.run(words, cwd=folder, env=environment, check=True, capture_output=True, text=True).stdout


@pytest.mark.skipif(not shutil.which("make"), reason="make is not installed")
def test_make_denoises_what_is_new_and_measures_what_is_known(scans):
    words = ("make", "OPTIONS=--method bilateral-normal")
    ran(scans, *words)
    expected = cn.denoise(BALL, method="bilateral-normal")
    for name in ("a", "b"):
        assert cn.read(scans / "denoised" / f"{name}.ply").mesh.vertices.tobytes() == expected.vertices.tobytes()
    measured = json.loads((scans / "measured" / "a.json").read_text())["measures"]
    assert measured["normal_error_deg"] == pytest.approx(cn.compare(expected, icosphere(2)).normal_error_deg)
    assert not (scans / "measured" / "b.json").exists()
    assert "denoise" not in ran(scans, *words)  # nothing is left to do
    os.utime(scans / "scans" / "b.ply")
    again = ran(scans, *words, "-n")  # shows what it would do
    assert "scans/b.ply" in again and "scans/a.ply" not in again


@pytest.mark.skipif(not shutil.which("snakemake"), reason="snakemake is not installed")
def test_snakemake_denoises_every_scan(scans):
    ran(scans, "snakemake", "--cores", "1")
    assert {path.name for path in (scans / "denoised").iterdir()} == {"a.ply", "b.ply"}


@pytest.mark.skipif(not shutil.which("dvc"), reason="dvc is not installed")
def test_dvc_denoises_and_measures(scans):
    shutil.copy(ROOT / "examples" / "dvc.yaml", scans)
    ran(scans, "dvc", "init", "--no-scm")
    ran(scans, "dvc", "repro")
    assert json.loads((scans / "measured" / "a.json").read_text())["measures"]["normal_error_deg"] < 10
    assert (scans / "denoised" / "b.ply").exists()


def test_the_template_compares_a_method_of_its_own(scans):
    for name in ("denoiser", "compare"):
        shutil.copy(ROOT / "examples" / "own_denoiser" / f"{name}.py", scans)
    pair = scans / "pairs" / "ball"
    pair.mkdir(parents=True)
    shutil.copy(scans / "scans" / "a.ply", pair / "noisy.ply")
    shutil.copy(scans / "truth" / "a.ply", pair / "clean.ply")
    ran(scans, sys.executable, "compare.py", "pairs")
    head, *rows = (line.split(",") for line in (scans / "comparison.csv").read_text().splitlines())
    error = {row[1]: float(row[head.index("normal_error_deg")]) for row in rows}
    assert list(error) == ["noisy", "own-denoiser", "auto", "bilateral-normal", "guided-normal"]
    assert error["own-denoiser"] < 0.6 * error["noisy"]
    assert "own-denoiser" in (scans / "comparison.html").read_text(encoding="utf-8")


@pytest.mark.slow  # every table and figure, one of them of the learned method
def test_one_command_makes_the_page_of_results(scans):
    pair = scans / "pairs" / "ball"
    pair.mkdir(parents=True)
    shutil.copy(scans / "scans" / "a.ply", pair / "noisy.ply")
    shutil.copy(scans / "truth" / "a.ply", pair / "clean.ply")
    command = (sys.executable, "-m", "benchmarks.accuracy.reproduce", "pairs", "paper")
    ran(scans, *command, "--method", "bilateral-normal", "--parts", "1", PYTHONPATH=str(ROOT))
    page = (scans / "paper" / "results.md").read_text(encoding="utf-8")
    assert page.count("| bilateral-normal |") >= 2 and "| 0.03 |" in page and "1 of 1 within" in page
    assert all((scans / "paper" / name).exists() for name in re.findall(r"\]\(([^)]+)\)", page))


@pytest.mark.skipif(not shutil.which("bash"), reason="bash is not installed")
def test_the_script_of_the_action_denoises_what_matches(scans):
    text = (ROOT / "action.yml").read_text(encoding="utf-8")
    script = re.search(r"run: \|\n(.*)", text, re.DOTALL)[1]
    arguments = "--method bilateral-normal --strength 0.5 --workers 1"
    (scans / "scans" / "more" / "deep").mkdir(parents=True)
    shutil.copy(scans / "scans" / "b.ply", scans / "scans" / "more" / "deep" / "c.ply")
    ran(scans, "bash", "-ec", script, FILES="scans/**/*.ply", OUTPUT="clean", ARGUMENTS=arguments)
    out = cn.read(scans / "clean" / "b.ply").mesh
    assert out.vertices.tobytes() == cn.denoise(BALL, method="bilateral-normal", strength=0.5).vertices.tobytes()
    assert (scans / "clean" / "more" / "deep" / "c.ply").exists()
    inputs, _ = text.split("\nruns:")
    assert set(re.findall(r"inputs\.(\w+)", text)) == set(re.findall(r"^  (\w+):$", inputs, re.MULTILINE))


def test_the_citation_names_this_version_and_the_papers_of_the_page():
    text, page = ((ROOT / name).read_text(encoding="utf-8") for name in ("CITATION.cff", "docs/citing.md"))
    assert f"\nversion: {cn.__version__}\n" in text
    assert set(re.findall(r"\n    doi: (\S+)", text)) == set(re.findall(r"\[doi:([^\]]+)\]", page))
