"""The commands that measure print what the library measures."""

import csv
import json
import re

import pytest
from commands import CLEAN, FAST, ROUGH, refused
from shapes import grid

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.io.interop import save_mesh


def test_pages_of_an_evaluation_are_html_files_as_reports_are(place, capsys):
    for words in (["evaluate", ".", "--html", "a.txt", "--keep", "kept"], ["inspect", "ball.ply", "--report", "a.txt"]):
        code, message = refused(capsys, *words)
        assert code == 5 and "a.txt is not the name of an HTML file: end it in .html" in message


def test_compare_prints_the_measures(place, capsys):
    assert run(["compare", "ball.ply", "true.ply", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    expected = cn.compare(ROUGH, CLEAN)
    assert found["command"] == "compare"
    assert found["measures"]["normal_error_deg"] == expected.normal_error_deg
    assert found["measures"]["volume_ratio"] == pytest.approx(expected.volume_ratio)
    assert run(["compare", "ball.ply", "true.ply"]) == 0
    (row,) = [line for line in capsys.readouterr().out.splitlines() if "mean angle E_a (°)" in line]
    assert f" {expected.normal_error_deg:.3f} " in row


def test_evaluate_prints_a_table_json_and_csv(pairs, tmp_path, capsys):
    table = tmp_path / "table.csv"
    assert run(["evaluate", str(pairs), *FAST, "--csv", str(table), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    expected = cn.evaluate([pairs], methods=["laplacian"])
    errors = [result.measures.normal_error_deg for result in expected.results]
    assert [row["normal_error_deg"] for row in found["results"]] == errors
    assert [(row["pair"], row["method"]) for row in found["means"]] == [("mean", "noisy"), ("mean", "laplacian")]
    assert found["failures"] == []
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["normal_error_deg"]) for row in rows] == errors
    assert rows[0]["volume_ratio"] and rows[2]["volume_ratio"] == ""  # a sheet encloses nothing
    assert refused(capsys, "evaluate", str(pairs), *FAST, "--csv", str(table))[0] == 5
    assert run(["evaluate", str(pairs), *FAST, "--csv", str(tmp_path / "no" / "table.csv")]) == 5
    capsys.readouterr()
    (tmp_path / "marked" / "[final]").mkdir(parents=True)
    for half in ("noisy.ply", "clean.ply"):
        (tmp_path / "marked" / "[final]" / half).write_bytes((pairs / "ball" / half).read_bytes())
    assert run(["evaluate", str(tmp_path / "marked"), *FAST]) == 0
    assert "[final]" in capsys.readouterr().out
    header = table.read_text().split("\n")[0]
    (tmp_path / "bad" / "one").mkdir(parents=True)
    for name in ("noisy.ply", "clean.ply"):
        (tmp_path / "bad" / "one" / name).write_bytes(b"")
    assert run(["evaluate", str(tmp_path / "bad"), *FAST, "--csv", str(tmp_path / "none.csv")]) == 6
    assert (tmp_path / "none.csv").read_text() == f"{header}\n"
    capsys.readouterr()

    assert run(["evaluate", str(pairs / "sheet"), *FAST]) == 0
    out = capsys.readouterr().out
    assert f"{errors[3]:.2f}" in out and "open" in out and "mean" in out


def test_a_bad_pair_is_exit_code_6_and_the_rest_is_shown(pairs, capsys):
    (pairs / "ball" / "noisy.ply").write_bytes(b"")
    assert run(["evaluate", str(pairs), *FAST, "--json"]) == 6
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert [row["pair"] for row in found["results"]] == ["sheet", "sheet"]
    assert found["failures"][0]["pair"] == "ball" and "empty" in found["failures"][0]["message"]
    assert err.count("\n") == 1 and "noisy.ply: the file is empty" in err


def test_evaluate_takes_results_of_other_programs(pairs, tmp_path, capsys):
    (tmp_path / "theirs").mkdir()
    save_mesh(tmp_path / "theirs" / "ball.ply", CLEAN)
    save_mesh(tmp_path / "theirs" / "sheet.ply", grid(3, 3))
    given = ["--result", f"theirs={tmp_path / 'theirs'}"]
    assert run(["evaluate", str(pairs), *FAST, *given, "--json"]) == 0
    out, err = capsys.readouterr()
    rows = [row for row in json.loads(out)["results"] if row["method"] == "theirs"]
    assert rows[0]["normal_error_deg"] == pytest.approx(0, abs=1e-4) and rows[0]["same_faces"]
    assert not rows[1]["same_faces"] and "sheet, theirs: faces differ from clean.*" in err
    (tmp_path / "theirs" / "ball.ply").unlink()
    assert run(["evaluate", str(pairs), *FAST, *given]) == 6
    out, err = capsys.readouterr()
    assert "theirs" in out and "holds no mesh ball.*" in err
    assert refused(capsys, "evaluate", str(pairs), "--result", "theirs")[0] == 2
    assert "theirs: the name is given twice" in refused(capsys, "evaluate", str(pairs), *given, *given)[1]
    assert refused(capsys, "evaluate", str(pairs), "--result", f"theirs={tmp_path / 'absent'}")[0] == 3


def test_spectrum_prints_eigenvalues_and_the_distance_of_two(place, capsys):
    assert run(["spectrum", "ball.ply", "true.ply", "-n", "5", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    expected = cn.spectrum(ROUGH, CLEAN, count=5)
    assert (found["command"], found["mesh"], found["other"], found["scale"]) == (
        "spectrum",
        "ball.ply",
        "true.ply",
        "area",
    )
    assert found["eigenvalues"] == pytest.approx(expected.values, abs=1e-6)
    assert found["other_eigenvalues"] == pytest.approx(expected.other, abs=1e-6)
    assert found["distance"] == pytest.approx(expected.distance)
    assert run(["spectrum", "ball.ply", "-n", "5", "--scale", "keep"]) == 0
    out = capsys.readouterr().out
    (fifth,) = re.findall(r"│ 5 │ +([\d.]+)", out)
    assert float(fifth) == pytest.approx(cn.spectrum(ROUGH, count=5, scale="keep").values[4], rel=1e-4)
    assert "distance" not in out
    assert run(["spectrum", "ball.ply", "true.ply", "-n", "5"]) == 0
    assert "distance: " in capsys.readouterr().out
    assert refused(capsys, "spectrum", "absent.ply")[0] == 3
    code, message = refused(capsys, "spectrum", "ball.ply", "-n", "100000")
    assert code == 2 and "ask for 1 to" in message
    assert refused(capsys, "spectrum", "ball.ply", "--scale", "size")[0] == 2
