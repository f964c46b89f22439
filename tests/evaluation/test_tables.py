"""Tables and pages of an evaluation."""

import csv
import io
import json
import os
import re
import shutil
import sys
from base64 import b64decode
from html import unescape

import PIL.Image
import pytest
from evaluated import COPY, SHAPES, python
from shapes import icosphere, noisy

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.cli.tables import print_evaluation
from cascadenorm.errors import DenoiseError, ParameterError
from cascadenorm.evaluation import tables
from cascadenorm.evaluation.harness import NOISY, Evaluation, FailedRun, evaluate
from cascadenorm.evaluation.records import Records
from cascadenorm.io import OutputError
from cascadenorm.io.interop import save_mesh
from cascadenorm.reports.evaluations import report_evaluation


@pytest.fixture(scope="module")
def measured(folder, tmp_path_factory) -> Evaluation:
    keep = tmp_path_factory.mktemp("kept")
    commands = {"a|b_c": python(COPY), "dies": python("raise SystemExit(1)")}
    return evaluate(folder, methods=["laplacian", "taubin"], commands=commands, keep=keep)


def test_the_best_of_each_pair_is_in_bold_and_never_the_input(measured):
    table = tables.pair_table(measured)
    assert [row[0].text for row in table.rows] == ["ball", "cube", "mean"]
    for row, pair in zip(table.rows, SHAPES, strict=False):
        errors = {r.method: r.measures.normal_error_deg for r in measured.results if r.pair == pair}
        assert [cell.text for cell in row[1:]] == [f"{errors[method]:.2f}" for method in measured.methods]
        best = min((method for method in errors if method != NOISY), key=errors.get)
        assert [method for method, cell in zip(measured.methods, row[1:], strict=True) if cell.best] == [best]
    means = tables.method_table(measured.means, "")
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


def test_spreads_over_fewer_pairs_are_marked(folder, tmp_path):
    for seed in range(2):
        shutil.copy(folder / "ball" / "noisy.ply", tmp_path / f"ball-seed{seed}.ply")
    done = evaluate(folder, methods=[], results={"theirs": tmp_path}, noise=0.2, seeds=2)
    table = tables.spread_table(done)
    assert table.title.endswith("not compared)") and [row[0].text for row in table.rows] == [NOISY, "theirs *"]


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
    listed = list(csv.DictReader(io.StringIO(tables.csv_text(measured))))
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
    assert text.count("<figure><svg") == 2 and text.count("currentColor") > 50
    assert all(f">{method}</text>" in text for method in measured.methods)
    data = [b64decode(found) for found in re.findall(r'image/webp;base64,([^"]+)', text)]
    # with enlarged parts and the truth, and errors
    sides = [PIL.Image.open(io.BytesIO(one)).size[0] for one in data]
    assert sum(side > 200 for side in sides) == 2 * (3 * len(measured.methods) + 2)
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


def test_errors_from_the_code_of_a_method_are_listed_with_their_type(tmp_path):
    failures = [FailedRun("ball", "mine", error) for error in (KeyError("seam"), DenoiseError("no vertices"))]
    report_evaluation(tmp_path / "e.html", Evaluation([], failures, records=Records(tmp_path / "kept")))
    text = unescape((tmp_path / "e.html").read_text(encoding="utf-8"))
    assert "<td>KeyError: 'seam'</td>" in text and "<td>no vertices</td>" in text


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


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has file names that are not valid Unicode")
def test_a_pair_whose_name_is_no_text_is_in_pages_and_tables(tmp_path):
    pair = tmp_path / os.fsdecode(b"ball\xff")
    pair.mkdir()
    save_mesh(pair / "noisy.ply", noisy(icosphere(2), 0.2))
    save_mesh(pair / "clean.ply", icosphere(2))
    files = ["--html", str(tmp_path / "e.html"), "--csv", str(tmp_path / "e.csv")]
    assert run(["evaluate", str(pair), "--method", "laplacian", *files]) == 0
    page = (tmp_path / "e.html").read_text(encoding="utf-8")
    assert 'href="e_files/ball%FF.html"' in page and "ball?" in page
    assert (tmp_path / "e_files" / f"{pair.name}.html").exists()
    assert "ball?,laplacian," in (tmp_path / "e.csv").read_text(encoding="utf-8")
