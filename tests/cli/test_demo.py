import io
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from cascadenorm.api.api import compare
from cascadenorm.cli import run
from cascadenorm.cli.demo import BEFORE_AFTER, ERRORS, EXAMPLES, demo, draw, table
from cascadenorm.io import OutputError
from cascadenorm.io.interop import as_mesh
from cascadenorm.render import Camera

METHOD = "bilateral-normal"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("somewhere") / "demo"


@pytest.fixture(scope="module")
def examples(folder):
    made = demo(folder, methods=(METHOD,))
    draw(made, folder)
    return made


def test_every_example_comes_out_closer_to_the_truth(examples):
    assert [example.name for example in examples] == list(EXAMPLES)
    for example in examples:
        (denoised,) = example.denoised
        assert denoised.angles.mean() < 0.7 * example.noisy.angles.mean()


def test_the_errors_are_those_that_compare_measures(examples):
    for example in examples:
        measured = compare(example.noisy.mesh, example.clean)
        assert example.noisy.angles.mean() == pytest.approx(measured.normal_error_deg, abs=1e-6)


def test_the_folder_holds_meshes_and_pictures(examples, folder):
    kept = {str(path.relative_to(folder)) for path in folder.rglob("*.*")}
    meshes = {str(Path(name) / f"{kind}.ply") for name in EXAMPLES for kind in ("noisy", "clean", METHOD)}
    assert kept == {BEFORE_AFTER, ERRORS} | meshes
    for example in examples:
        saved = as_mesh(folder / example.name / f"{METHOD}.ply")
        assert np.array_equal(saved.vertices, example.denoised[0].mesh.vertices)


def test_the_examples_are_seen_from_outside(examples):
    for example in examples:
        camera = Camera.looking_at(example.clean, direction=EXAMPLES[example.name])
        facing = example.clean.area_vectors @ camera.axes[2]
        assert facing[facing > 0].sum() > 0.95 * -facing[facing < 0].sum()


def test_the_table_has_a_line_for_each_example(examples):
    printed = io.StringIO()
    Console(file=printed, width=100).print(table(examples))
    text = printed.getvalue()
    for example in examples:
        assert f"{example.name} " in text
        assert f"{example.denoised[0].angles.mean():.2f}°" in text


def test_a_second_run_replaces_its_own_files_with_force_alone_and_no_other(examples, folder, capsys):
    assert run(["demo", str(folder)]) == 5
    assert "clean.ply exists already" in (said := capsys.readouterr().err) and "--force" in said
    (folder / "notes.txt").write_text("mine")
    before = (folder / ERRORS).read_bytes()
    (folder / ERRORS).write_text("old")
    draw(demo(folder, methods=(METHOD,), force=True), folder)
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
