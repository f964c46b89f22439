"""The demonstration denoises and draws its examples, and leaves other files alone."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cascadenorm.api.api import compare
from cascadenorm.cli import run
from cascadenorm.cli.demo import BEFORE_AFTER, ERRORS, EXAMPLES, demo, draw_demo, example_meshes
from cascadenorm.io import OutputError
from cascadenorm.io.interop import as_mesh
from cascadenorm.render import Camera

METHOD = "bilateral-normal"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("somewhere") / "demo"


@pytest.fixture(scope="module")
def done(folder):
    made = demo(folder, methods=(METHOD,))
    draw_demo(made, folder)
    return made


def test_every_example_comes_out_closer_to_the_truth(done):
    assert [pair.name for pair in done.pairs] == list(EXAMPLES)
    for noisy, denoised in zip(done.results[::2], done.results[1::2], strict=True):
        assert (noisy.method, denoised.method) == ("noisy", METHOD)
        assert denoised.measures.normal_error_deg < 0.7 * noisy.measures.normal_error_deg


def test_the_errors_are_those_that_compare_measures(done):
    for pair, noisy in zip(done.pairs, done.results[::2], strict=True):
        assert compare(pair.noisy, pair.clean) == noisy.measures


def test_the_folder_holds_meshes_measures_and_pictures(done, folder):
    kept = {str(path.relative_to(folder)) for path in folder.rglob("*.*")}
    results = {
        str(Path(name) / f"{kind}.{end}") for name in EXAMPLES for kind in ("noisy", METHOD) for end in ("ply", "json")
    }
    assert kept == {BEFORE_AFTER, ERRORS} | results | {str(Path(name) / "clean.ply") for name in EXAMPLES}
    for pair in done.pairs:
        noisy, _, clean = example_meshes(done, pair)
        assert np.array_equal(clean.vertices, as_mesh(folder / pair.name / "clean.ply").vertices)
        assert np.array_equal(noisy.vertices, as_mesh(pair.noisy).vertices)


def test_the_examples_are_seen_from_outside(done):
    for pair in done.pairs:
        clean = as_mesh(pair.clean)
        facing = clean.area_vectors @ Camera.looking_at(clean, direction=EXAMPLES[pair.name]).axes[2]
        assert facing[facing > 0].sum() > 0.95 * -facing[facing < 0].sum()


def test_a_second_run_replaces_its_own_files_with_force_alone_and_no_other(done, folder, capsys):
    assert run(["demo", str(folder)]) == 5
    assert "clean.ply exists already" in (said := capsys.readouterr().err) and "--force" in said
    (folder / "notes.txt").write_text("mine")
    before = (folder / ERRORS).read_bytes()
    (folder / ERRORS).write_text("old")
    (folder / "part" / f"{METHOD}.ply").write_text("old")
    draw_demo(demo(folder, methods=(METHOD,), force=True), folder)
    assert (folder / "notes.txt").read_text() == "mine"
    assert (folder / ERRORS).read_bytes() == before
    (folder / "notes.txt").unlink()


def test_a_file_in_the_place_of_the_folder_is_left_alone(tmp_path, capsys):
    (tmp_path / "taken").write_text("mine")
    with pytest.raises(OutputError, match="taken"):
        demo(tmp_path / "taken", methods=(METHOD,))
    assert run(["demo", str(tmp_path / "taken")]) == 5
    assert "taken" in capsys.readouterr().err
    assert (tmp_path / "taken").read_text() == "mine"


@pytest.mark.slow  # shapes are drawn and meshed anew
def test_the_script_makes_the_examples_byte_for_byte(tmp_path):
    root = Path(__file__).parents[2]
    script = root / "docs" / "generate" / "make_demo_data.py"
    subprocess.run([sys.executable, script, tmp_path], check=True, stdout=subprocess.DEVNULL)
    kept = root / "cascadenorm" / "demo_data"
    made = sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*.ply"))
    assert made == sorted(path.relative_to(kept) for path in kept.rglob("*.ply"))
    for path in made:
        assert (tmp_path / path).read_bytes() == (kept / path).read_bytes(), path
        assert (kept / path).stat().st_size < 250_000
