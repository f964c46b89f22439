import csv
import importlib
import io
import json
import re
import shlex
import shutil
import subprocess
import sys
import time
from base64 import b64decode
from dataclasses import replace
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from shapes import cube, icosphere, noisy

import cascadenorm as cn
from cascadenorm import registry
from cascadenorm.cli import run
from cascadenorm.cli.tables import print_evaluation
from cascadenorm.errors import MissingDependencyError, ParameterError
from cascadenorm.evaluation import pairs as pairs_module
from cascadenorm.evaluation import public_sets, runs, tables
from cascadenorm.evaluation.harness import NOISY, Evaluation, evaluate
from cascadenorm.evaluation.programs import command_words
from cascadenorm.evaluation.public_sets import public_pairs
from cascadenorm.execution.memory import peak_memory
from cascadenorm.geometry.metrics import measure
from cascadenorm.io import OutputError, ReadError
from cascadenorm.io.digests import source_digest
from cascadenorm.io.interop import save_mesh
from cascadenorm.io.pairs import find_pairs
from cascadenorm.models.training_pairs import write_pairs
from cascadenorm.reports.evaluations import report_evaluation

SHAPES = {"ball": icosphere(2), "cube": cube(4)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    root = tmp_path_factory.mktemp("pairs")
    for name, clean in SHAPES.items():
        (root / name).mkdir()
        save_mesh(root / name / "noisy.ply", noisy(clean, 0.2))
        save_mesh(root / name / "clean.ply", clean)
    (root / "notes").mkdir()
    return root


def test_pairs_are_found_in_a_folder_and_in_the_folders_in_it(folder, tmp_path):
    assert [pair.name for pair in find_pairs([folder])] == ["ball", "cube"]
    assert [pair.name for pair in find_pairs([folder / "cube", folder / "ball"])] == ["cube", "ball"]
    assert [pair.name for pair in find_pairs([folder, folder / "ball"])] == ["ball", "cube"]
    other = shutil.copytree(folder / "ball", tmp_path / "ball")
    both = [pair.name for pair in find_pairs([folder, other])]
    assert both == [str(folder / "ball"), str(folder / "cube"), str(other)]


def test_folders_without_pairs_are_refused(folder, tmp_path):
    with pytest.raises(ReadError, match="is not a folder"):
        find_pairs([folder / "absent"])
    with pytest.raises(ReadError, match="holds no pairs"):
        find_pairs([folder / "notes"])
    (tmp_path / "noisy.ply").touch()
    with pytest.raises(ReadError, match=r"holds noisy\.ply only"):
        find_pairs([tmp_path])
    (tmp_path / "clean.gltf").touch()
    for beside in ("noisy.mtl", "clean.bin", "clean.png"):  # what a mesh file names is none itself
        (tmp_path / beside).touch()
    assert [(pair.noisy.name, pair.clean.name) for pair in find_pairs([tmp_path])] == [("noisy.ply", "clean.gltf")]
    (tmp_path / "noisy.obj").touch()
    with pytest.raises(ReadError, match=r"holds 2 files noisy\.\*"):
        find_pairs([tmp_path])


def test_measures_are_those_of_the_denoised_mesh(folder):
    done = evaluate([folder], methods=["bilateral-normal"], parameters={"iterations": "0", "sweeps": 0})
    assert [(r.pair, r.method) for r in done.results] == [
        (name, method) for name in SHAPES for method in (NOISY, "bilateral-normal")
    ]
    for result in done.results:  # no passes, no sweeps: the method gives back what it got
        assert result.measures == measure(noisy(SHAPES[result.pair], 0.2), SHAPES[result.pair])
    assert done.failures == []


def test_means_are_over_the_pairs(folder):
    done = evaluate([folder], methods=["bilateral-normal"])
    errors = [r.measures.normal_error_deg for r in done.results]
    assert [mean.measures.normal_error_deg for mean in done.means] == [
        pytest.approx((errors[0] + errors[2]) / 2),
        pytest.approx((errors[1] + errors[3]) / 2),
    ]
    assert errors[1] < 0.6 * errors[0] and errors[3] < 0.6 * errors[2]


def test_one_folder_and_one_method_need_no_list(folder):
    done = evaluate(str(folder / "ball"), methods="laplacian")
    assert [(r.pair, r.method) for r in done.results] == [("ball", NOISY), ("ball", "laplacian")]


def test_a_method_without_memory_is_listed_and_the_rest_goes_on(folder, monkeypatch):
    def hungry(mesh):
        np.empty(2**60)

    monkeypatch.setitem(registry._methods, "hungry", registry.Method("hungry", hungry, "", {}))
    done = evaluate(folder, methods=["hungry", "laplacian"])
    assert [r.method for r in done.results] == [NOISY, "laplacian"] * 2
    assert [(f.pair, f.method) for f in done.failures] == [("ball", "hungry"), ("cube", "hungry")]


def test_progress_counts_all_parts_once(folder):
    seen = []
    evaluate([folder, folder / "ball"], methods=["laplacian", "laplacian"], progress=lambda *what: seen.append(what))
    assert seen == [
        ("evaluating", 0, 4, "ball: noisy"),
        ("evaluating", 1, 4, "ball: laplacian"),
        ("evaluating", 2, 4, "cube: noisy"),
        ("evaluating", 3, 4, "cube: laplacian"),
        ("evaluating", 4, 4),
    ]


def test_one_bad_pair_does_not_end_the_evaluation(folder, tmp_path):
    for pair in ("a_bad", "b_good"):
        (tmp_path / pair).mkdir()
        for half in ("noisy.ply", "clean.ply"):
            (tmp_path / pair / half).write_bytes((folder / "ball" / half).read_bytes())
    (tmp_path / "a_bad" / "noisy.ply").write_bytes(b"ply\nrubbish")
    done = evaluate([tmp_path], methods=["laplacian"])
    assert [result.pair for result in done.results] == ["b_good", "b_good"]
    assert [(failure.pair, failure.method) for failure in done.failures] == [("a_bad", None)]
    assert "noisy.ply" in str(done.failures[0].error)


@pytest.mark.parametrize("wrong", [{"strength": -1.0}, {"strength": np.inf}, {"threads": 0}])
def test_wrong_strength_and_threads_are_refused_before_any_work(folder, wrong):
    with pytest.raises(ParameterError, match=next(iter(wrong))):
        evaluate([folder], methods=["laplacian"], **wrong)


def test_unknown_methods_and_parameters_are_refused_before_any_work(folder):
    with pytest.raises(ParameterError, match="there is no method 'magic'"):
        evaluate([folder / "absent"], methods=["magic"])
    with pytest.raises(ParameterError, match="laplacian has no parameter 'wings'"):
        evaluate([folder / "absent"], methods=["laplacian"], parameters={"wings": 1})


def test_generated_pairs_can_be_evaluated_and_repeat(tmp_path):
    for name in ("one", "two"):
        write_pairs(tmp_path / name, count=1, seed=3)
    (pair,), (again,) = find_pairs([tmp_path / "one"]), find_pairs([tmp_path / "two"])
    assert pair.noisy.read_bytes() == again.noisy.read_bytes()
    done = evaluate([tmp_path / "one"], methods=[])
    assert done.results[0].measures.normal_error_deg > 0
    with pytest.raises(OutputError, match="is not empty"):
        write_pairs(tmp_path / "one", count=1, seed=3)
    with pytest.raises(OutputError, match="is a file"):
        write_pairs(pair.noisy, count=1, seed=3)
    assert np.isfinite(done.means[0].measures.vertex_error_edges)


def test_results_of_other_programs_are_rows_like_methods(folder, tmp_path):
    for name, clean in SHAPES.items():
        save_mesh(tmp_path / f"{name}.obj", noisy(clean, 0.1, seed=1))
    done = evaluate([folder], methods=[], results={"theirs": tmp_path})
    assert [(r.pair, r.method) for r in done.results] == [(n, m) for n in SHAPES for m in (NOISY, "theirs")]
    for result in done.results[1::2]:
        clean = SHAPES[result.pair]
        expected = measure(noisy(clean, 0.1, seed=1), clean)
        assert result.measures.normal_error_deg == pytest.approx(expected.normal_error_deg)
        assert result.same_faces and result.seconds == 0
    assert [mean.method for mean in done.means] == [NOISY, "theirs"]


def test_missing_results_are_failures_and_other_faces_are_measured_and_said(folder, tmp_path):
    save_mesh(tmp_path / "ball.ply", icosphere(3))
    done = evaluate([folder], methods=[], results={"theirs": tmp_path})
    assert [(failure.pair, failure.method) for failure in done.failures] == [("cube", "theirs")]
    assert "holds no mesh cube.*" in str(done.failures[0].error)
    theirs = done.results[1]
    assert not theirs.same_faces and theirs.measures == measure(icosphere(3), SHAPES["ball"])
    assert not done.means[1].same_faces and done.means[0].same_faces
    save_mesh(tmp_path / "ball.off", icosphere(3))
    done = evaluate([folder / "ball"], methods=[], results={"theirs": tmp_path})
    assert "holds 2 meshes ball.*" in str(done.failures[0].error)


def test_results_without_a_folder_or_a_name_of_their_own_are_refused(folder, tmp_path):
    with pytest.raises(ReadError, match="is not a folder"):
        evaluate([folder], methods=[], results={"theirs": tmp_path / "absent"})
    for name in (NOISY, "laplacian"):
        with pytest.raises(ParameterError, match=f"the results '{name}' have the name of a method"):
            evaluate([folder], methods=["laplacian"], results={name: tmp_path})
    other = shutil.copytree(folder / "ball", tmp_path / "ball")
    with pytest.raises(ReadError, match="several pairs are named ball"):
        evaluate([folder, other], methods=[], results={"theirs": tmp_path})


# other programs

COPY = (
    "import sys, shutil; shutil.copyfile(*sys.argv[1:]); x = bytearray(120_000_000); x[::4096] = b'1' * len(x[::4096])"
)


def python(code):
    """The command line of a program that gets both names of files."""
    return f"{sys.executable} -c {shlex.quote(code)} {{in}} {{out}}"


def test_a_program_is_run_on_each_noisy_mesh_timed_and_measured(folder):
    done = evaluate(folder, methods=[], commands={"copy": python(COPY)})
    assert [(r.pair, r.method) for r in done.results] == [(n, m) for n in SHAPES for m in (NOISY, "copy")]
    for before, after in zip(done.results[::2], done.results[1::2], strict=True):
        assert after.measures == before.measures and after.seconds > 0
        assert before.seconds == 0 and before.memory_mb is None
    if sys.platform.startswith("linux"):
        assert all(120 < result.memory_mb < 180 for result in done.results[1::2])  # not that of this process


def test_a_program_gets_files_of_the_format_that_it_asks_for(folder, tmp_path):
    script = tmp_path / "their tool.py"
    script.write_text(
        "import sys\n"
        "assert sys.argv[1].endswith('.obj') and sys.argv[2].endswith('.off')\n"
        "from cascadenorm.io.interop import as_mesh, save_mesh\n"
        "from pathlib import Path\n"
        "save_mesh(Path(sys.argv[2]), as_mesh(sys.argv[1]))\n"
    )
    command = f"{sys.executable} '{script}' {{in.obj}} {{out.off}}"
    done = evaluate(folder / "ball", methods=[], commands={"theirs": command})
    assert done.failures == []
    errors = [result.measures.normal_error_deg for result in done.results]
    assert errors[1] == pytest.approx(errors[0], abs=1e-3)


def test_the_failures_of_a_program_are_shown_and_the_rest_goes_on(folder):
    commands = {
        "dies": python("import sys; print('no such grid', file=sys.stderr); sys.exit(3)"),
        "silent": python("pass"),
        "rubbish": python("import sys; open(sys.argv[2], 'w').write('ply')"),
        "copy": python(COPY),
    }
    done = evaluate(folder / "ball", methods=[], commands=commands)
    assert [result.method for result in done.results] == [NOISY, "copy"]
    said = {failure.method: str(failure.error) for failure in done.failures}
    assert said["dies"].endswith("ended with code 3: no such grid")
    assert said["silent"].endswith("wrote no file out.ply") and "out.ply" in said["rubbish"]


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("cp {in} somewhere", "needs {in} and {out}"),
        ("no-such-program {in} {out}", "there is no program no-such-program"),
        ("cp '{in} {out}", "cannot be read"),
    ],
)
def test_commands_that_cannot_run_are_refused_before_any_work(folder, command, message):
    with pytest.raises(ParameterError, match=re.escape(message)):
        evaluate(folder, methods=[], commands={"theirs": command})


def test_names_of_rows_differ_and_can_be_those_of_files(folder):
    with pytest.raises(ParameterError, match="two rows are named 'one'"):
        evaluate(folder, methods=[], commands={"one": "cp {in} {out}"}, results={"one": folder})
    with pytest.raises(ParameterError, match="which is not a file name"):
        evaluate(folder, methods=[], commands={"a/b": "cp {in} {out}"})


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the system does not tell")
def test_the_memory_of_a_block_is_what_it_touched():
    with peak_memory() as peak:
        np.ones(25_000_000)
    assert peak.megabytes == pytest.approx(200, rel=0.1)
    with peak_memory() as peak:
        np.ones(1000)
    assert peak.megabytes < 20


# going on


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


def test_a_function_without_a_file_is_known_by_its_code():
    def made(text):
        names = {"__name__": "no_module"}
        exec(text, names)
        return source_digest(names["smoothed"])

    code = "def helper(x):\n    return {} * x\ndef smoothed(x):\n    return helper(x)\n"
    assert made(code.format(2)) == made("\n\n" + code.format(2)) != made(code.format(3))
    assert source_digest(evaluate) == ""  # of this package, which has a version


def test_pairs_that_cannot_be_read_are_listed_and_the_rest_goes_on(folder, tmp_path, monkeypatch):
    pairs = shutil.copytree(folder, tmp_path / "pairs")
    for name in ("damaged", "foreign"):
        shutil.copytree(pairs / "ball", pairs / name)
    (pairs / "damaged" / "clean.ply").write_bytes(b"ply\nno more")
    read = runs.as_mesh

    def without_package(path):
        if Path(path).parent.name == "foreign":
            raise MissingDependencyError("reading '3mf' files", package="lxml", extra="formats")
        return read(path)

    for module in (runs, pairs_module):
        monkeypatch.setattr(module, "as_mesh", without_package)
    for noise in (None, 0.1):
        done = evaluate(pairs, methods="laplacian", noise=noise)
        failed = {failure.pair.partition("-seed")[0]: str(failure.error) for failure in done.failures}
        assert set(failed) == {"damaged", "foreign"} and "lxml" in failed["foreign"]
        assert {result.pair.partition("-seed")[0] for result in done.results} == set(SHAPES)


def test_whatever_a_method_ends_in_is_listed(folder, monkeypatch):
    def broken(mesh):
        return mesh.vertices[len(mesh.vertices)]

    monkeypatch.setitem(registry._methods, "broken", registry.Method("broken", broken, "", {}))
    done = evaluate(folder / "ball", methods=["broken", "laplacian"])
    assert [(f.method, type(f.error)) for f in done.failures] == [("broken", IndexError)]
    assert [result.method for result in done.results] == [NOISY, "laplacian"]


@pytest.mark.skipif(sys.platform == "win32", reason="the program is a shell")
def test_a_program_that_takes_too_long_is_stopped_with_all_that_it_started(folder, tmp_path):
    alive = tmp_path / "alive"
    waits = f"while true; do touch {shlex.quote(str(alive))}; sleep 0.05; done"
    command = f"sh -c {shlex.quote(f'({waits}) & wait; : {{in}} {{out}}')}"
    done = evaluate(folder / "ball", methods=[], commands={"hangs": command}, timeout=2.0)
    (failure,) = done.failures
    assert failure.method == "hangs" and "took longer than 2 seconds, and was stopped" in str(failure.error)
    alive.unlink(missing_ok=True)
    time.sleep(0.5)
    assert not alive.exists()
    with pytest.raises(ParameterError, match="timeout is 0"):
        evaluate(folder, methods=[], timeout=0)


def test_backslashes_are_kept_on_windows_and_quotes_are_read_everywhere():
    command = r'"C:\Program Files\tool.exe" {in} C:\out\{out} \\server\share'
    expected = [r"C:\Program Files\tool.exe", "{in}", r"C:\out\{out}", r"\\server\share"]
    assert command_words(command, windows=True) == expected
    assert command_words(r"tool\ 1 'a b' {in} #3", windows=False) == ["tool 1", "a b", "{in}", "#3"]


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


def test_processes_measure_the_same(folder):
    settings = {"methods": ["laplacian", "taubin"], "commands": {"copy": python(COPY)}}
    one, two = (evaluate(folder, workers=workers, **settings) for workers in (1, 2))
    key = [(result.pair, result.method, result.measures) for result in one.results]
    assert [(result.pair, result.method, result.measures) for result in two.results] == key
    with pytest.raises(ParameterError, match="workers is 0"):
        evaluate(folder, methods=[], workers=0)


# tables and pages


@pytest.fixture(scope="module")
def measured(folder, tmp_path_factory) -> Evaluation:
    keep = tmp_path_factory.mktemp("kept")
    commands = {"a|b_c": python(COPY), "dies": python("raise SystemExit(1)")}
    return evaluate(folder, methods=["laplacian", "taubin"], commands=commands, keep=keep)


def test_the_best_of_each_pair_is_in_bold_and_never_the_input(measured):
    table = tables.by_pair(measured)
    assert [row[0].text for row in table.rows] == ["ball", "cube", "mean"]
    for row, pair in zip(table.rows, SHAPES, strict=False):
        errors = {r.method: r.measures.normal_error_deg for r in measured.results if r.pair == pair}
        assert [cell.text for cell in row[1:]] == [f"{errors[method]:.2f}" for method in measured.methods]
        best = min((method for method in errors if method != NOISY), key=errors.get)
        assert [method for method, cell in zip(measured.methods, row[1:], strict=True) if cell.best] == [best]
    means = tables.by_method(measured.means, "")
    volume = next(number for number, title in enumerate(means.head) if "volume" in title)
    ratios = {one.method: abs(one.measures.volume_ratio - 1) for one in measured.means if one.method != NOISY}
    assert [row[0].text for row in means.rows if row[volume].best] == [min(ratios, key=ratios.get)]


def test_means_over_fewer_pairs_are_marked_and_never_the_best(measured, capsys):
    """A method that fails on the hard pair would else win."""
    worse = max(SHAPES, key=lambda pair: next(r for r in measured.results if r.pair == pair).measures.normal_error_deg)
    kept = [r for r in measured.results if (r.pair, r.method) != (worse, "taubin")]
    part = measured._replace(results=kept)
    assert part.partial == {"taubin"} and not measured.partial
    of_pair, means = tables.all_tables(part)
    column = 1 + part.methods.index("taubin")
    assert of_pair.rows[-1][column].text.endswith(" *") and not of_pair.rows[-1][column].best
    assert of_pair.rows[0][column].text[-1] != "*" and any(cell.best for cell in of_pair.rows[-1])
    (row,) = (row for row in means.rows if row[0].text == "taubin *")
    assert not any(cell.best for cell in row) and any(cell.best for row in means.rows for cell in row)
    assert "not compared" in of_pair.title and "not compared" in means.title
    print_evaluation(part)
    assert "not compared" in " ".join(capsys.readouterr().out.split())


def test_tables_are_written_for_pages_and_papers(measured):
    page = tables.markdown(tables.all_tables(measured))
    assert "| a\\|b_c |" in page and page.count("| pair |") == 1
    (row,) = (line for line in page.splitlines() if line.startswith("| ball |"))
    assert row.count("**") == 2
    paper = tables.latex(tables.all_tables(measured))
    assert paper.count(r"\begin{tabular}") == paper.count(r"\end{tabular}") == 2
    assert r"a|b\_c" in paper and r"flipped (\%)" in paper and r"$E_a$ ($^\circ$)" in paper
    for table in paper.split(r"\begin{tabular}")[1:]:
        rows = [line for line in table.splitlines() if line.endswith(r"\\")]
        assert len({row.replace(r"\&", "").count("&") for row in rows}) == 1
    listed = list(csv.DictReader(io.StringIO(tables.comma_separated(measured))))
    assert [row["method"] for row in listed] == [result.method for result in measured.results]
    assert float(listed[1]["vertex_rms_edges"]) == measured.results[1].measures.vertex_rms_edges


def test_pages_have_tables_figures_and_the_viewer(measured, tmp_path):
    report_evaluation(tmp_path / "e.html", measured)
    text = (tmp_path / "e.html").read_text(encoding="utf-8")
    assert "ended with code 1" in text and text.count("<strong>") > 10
    bars = re.findall(r"<dt>([^<]*)</dt><dd><i[^>]*width: ([\d.]+)%", text)
    angles = {one.method: one.measures.normal_error_deg for one in measured.means}
    assert [name.removesuffix(" *") for name, _ in bars] == sorted(angles, key=angles.get)
    for name, width in bars:
        share = angles[name.removesuffix(" *")] / max(angles.values())
        assert float(width) == pytest.approx(100 * share, abs=0.06)
    assert "E_a is the mean angle between the face normals" in text
    data = [b64decode(found) for found in re.findall(r'image/webp;base64,([^"]+)', text)]
    assert len(data) == 2 and all(PIL.Image.open(io.BytesIO(one)).size[0] > 1200 for one in data)
    for name in SHAPES:
        assert f'href="e_files/{name}.html"' in text
        page = (tmp_path / "e_files" / f"{name}.html").read_text(encoding="utf-8")
        scene = json.loads(re.search(r'id="scene">(.*?)</script>', page)[1])
        assert [mesh["name"] for mesh in scene["meshes"]] == [*measured.methods, "truth"]
        (field,) = (field for field in scene["fields"] if field["name"] == "normal-error")
        assert set(field["of"]) == set(measured.methods)
    first = (tmp_path / "e.html").read_bytes()
    report_evaluation(tmp_path / "e.html", measured, force=True)
    assert (tmp_path / "e.html").read_bytes() == first
    with pytest.raises(OutputError, match="exists already"):
        report_evaluation(tmp_path / "e.html", measured)
    with pytest.raises(ParameterError, match="were not kept"):
        report_evaluation(tmp_path / "other.html", measured._replace(records=None))


def test_meshes_without_common_faces_are_in_the_pages_too(tmp_path):
    (tmp_path / "ball").mkdir()
    save_mesh(tmp_path / "ball" / "noisy.ply", noisy(icosphere(2), 0.2))
    save_mesh(tmp_path / "ball" / "clean.ply", icosphere(3))
    page = ["--html", str(tmp_path / "e.html"), "--markdown", str(tmp_path / "e.md")]
    assert run(["evaluate", str(tmp_path / "ball"), "--method", "laplacian", *page]) == 0
    assert (tmp_path / "e_files" / "ball.html").exists()
    error = cn.compare(tmp_path / "e_files" / "ball" / "laplacian.ply", icosphere(3)).normal_error_deg
    assert (
        f"| ball | {cn.compare(tmp_path / 'ball' / 'noisy.ply', icosphere(3)).normal_error_deg:.2f} | {error:.2f} |"
        in (tmp_path / "e.md").read_text(encoding="utf-8")
    )


# public sets and seeds


@pytest.fixture
def archive(tmp_path):
    """A copy of a set that has many files, with one clean mesh for tests and one for a training."""
    for split, name in (("test", "ball"), ("train", "cube")):
        for kind in ("noisy", "original"):
            (tmp_path / "Synthetic" / split / kind).mkdir(parents=True)
        save_mesh(tmp_path / "Synthetic" / split / "original" / f"{name}.obj", SHAPES[name])
        for level in (1, 2):
            mesh = noisy(SHAPES[name], level / 10)
            save_mesh(tmp_path / "Synthetic" / split / "noisy" / f"{name}_n{level}.obj", mesh)
    return tmp_path


def test_pairs_of_a_public_set_are_split_as_in_its_paper(archive):
    pairs = public_pairs("synthetic", archive)
    assert [pair.name for pair in pairs] == ["ball_n1", "ball_n2"]
    assert {pair.clean.name for pair in pairs} == {"ball.obj"}
    assert [pair.name for pair in public_pairs("synthetic", archive / "Synthetic", split="train")] == [
        "cube_n1",
        "cube_n2",
    ]
    done = evaluate(pairs, methods="bilateral-normal")
    assert [one.pair for one in done.results] == ["ball_n1", "ball_n1", "ball_n2", "ball_n2"]
    with pytest.raises(ReadError, match=r"has no folder Kinect_v1/test: get the set: https://github\.com/"):
        public_pairs("kinect-v1", archive)
    (archive / "Synthetic" / "test" / "original" / "ball.obj").unlink()
    with pytest.raises(ReadError, match=r"has no clean mesh original/ball\.obj"):
        public_pairs("synthetic", archive)


def test_listed_pairs_are_checked_by_digests_that_no_format_changes(tmp_path, monkeypatch):
    for name, mesh in (("n", noisy(SHAPES["ball"], 0.2)), ("c", SHAPES["ball"])):
        single = mesh.moved(mesh.vertices.astype(np.float32).astype(float))
        for suffix in ("obj", "ply", "off"):
            save_mesh(tmp_path / f"{name}.{suffix}", single)
    digests = tuple(public_sets.mesh_digest(tmp_path / f"{name}.obj") for name in "nc")
    assert (
        digests == tuple(public_sets.mesh_digest(tmp_path / f"{name}.ply") for name in "nc") and len(set(digests)) == 2
    )
    guided = replace(public_sets.PUBLIC_SETS["guided"], listed={"ball": public_sets.Listed("n.off", "c.ply", digests)})
    monkeypatch.setitem(public_sets.PUBLIC_SETS, "guided", guided)
    assert [pair.name for pair in public_pairs("guided", tmp_path)] == ["ball"]
    with pytest.raises(ParameterError, match="the set guided has only a test split"):
        public_pairs("guided", tmp_path, split="train")
    save_mesh(tmp_path / "n.off", SHAPES["ball"], force=True)
    with pytest.raises(ReadError, match=r"n\.off differs from the published mesh"):
        public_pairs("guided", tmp_path)
    (tmp_path / "n.off").unlink()
    with pytest.raises(ReadError, match=r"n\.off is missing: get the set: git clone"):
        public_pairs("guided", tmp_path)


def test_the_command_says_where_public_sets_are_and_evaluates_a_copy(archive, capsys):
    assert run(["evaluate", "--dataset", "list"]) == 0
    text = capsys.readouterr().out
    assert all(f"{name}: " in text and one.place in text for name, one in public_sets.PUBLIC_SETS.items())
    assert run(["evaluate", "--dataset", "synthetic"]) == 2
    assert "to get one: https://github.com/zhangyk18/GeoBi-GNN" in capsys.readouterr().err
    assert run(["evaluate", "--dataset", "sintetic", "--from", str(archive)]) == 2
    assert run(["evaluate", "--from", str(archive)]) == 2 and run(["evaluate"]) == 2
    words = ["evaluate", "--dataset", "synthetic", "--from", str(archive), "--method", "bilateral-normal", "--json"]
    capsys.readouterr()
    assert run(words) == 0
    assert {row["pair"] for row in json.loads(capsys.readouterr().out)["results"]} == {"ball_n1", "ball_n2"}


def test_noise_from_seeds_replaces_the_noisy_meshes_and_the_spread_is_told(folder, tmp_path):
    done = evaluate(folder, methods="bilateral-normal", noise=0.2, seeds=3, keep=tmp_path)
    assert [pair.name for pair in done.pairs][:3] == ["ball-seed0", "ball-seed1", "ball-seed2"]
    clean = SHAPES["ball"]
    made = [cn.read(pair.noisy).mesh for pair in done.pairs[:3]]
    offsets = [np.einsum("ij,ij->i", mesh.vertices - clean.vertices, clean.vertex_normals) for mesh in made]
    for offset in offsets:
        assert offset.std() == pytest.approx(0.2 * clean.mean_edge_length, rel=0.15)
    assert abs(np.corrcoef(offsets)[0, 1]) < 0.3
    means = [
        np.mean([one.measures.normal_error_deg for one in done.results if one.method == "bilateral-normal"
                 and done.seeds[one.pair] == seed])
        for seed in range(3)
    ]  # fmt: skip
    table = tables.all_tables(done)[-1]
    assert table.title == "Mean ± standard deviation over 3 seeds"
    assert table.rows[1][:2] == (
        ("bilateral-normal", False),
        (f"{np.mean(means):.3f} ± {np.std(means, ddof=1):.3f}", False),
    )
    assert "$\\pm$" in tables.latex([table])
    again = evaluate(folder, methods="bilateral-normal", noise=0.2, seeds=1)
    assert again.results[1].measures == done.results[1].measures
    assert len(tables.all_tables(again)) == 2


@pytest.mark.parametrize("wrong", [{"noise": -1.0}, {"noise": float("nan")}, {"seeds": 3}, {"noise": 0.1, "seeds": 0}])
def test_noise_and_seeds_out_of_range_are_refused(folder, wrong):
    with pytest.raises(ParameterError, match="it must be at least"):
        evaluate(folder, methods="bilateral-normal", **wrong)
