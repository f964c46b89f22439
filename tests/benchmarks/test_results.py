"""Tables of the pages are those of the records."""

import argparse
import json

import pytest

from benchmarks import results


@pytest.mark.parametrize("name", results.PAGES)
def test_pages_show_the_records(name):
    page, function = results.PAGES[name]
    if name == "opening":
        pytest.importorskip("selenium")
    if name == "round-trips":
        pytest.importorskip("trimesh")
    text = (results.ROOT / page).read_text(encoding="utf-8")
    table = results.table_of(function)(results.read(name))
    assert results.with_table(text, name, table) == text, f"run python -m benchmarks.results {name}"


def test_a_table_replaces_what_is_between_its_markers_alone():
    page = "a\n<!-- one: first -->\nold\n<!-- end of one -->\n<!-- two: second -->\nkept\n<!-- end of two -->\n"
    found = results.with_table(page, "one", "new\n")
    assert found == page.replace("old", "new")
    assert results.with_table(found, "two", "new") == found.replace("kept", "new")
    for wrong in ("three", ""):
        with pytest.raises(SystemExit, match="exactly once"):
            results.with_table(page, wrong, "new")


def test_figures_are_printed_and_only_kept_under_a_name(tmp_path, capsys):
    def table(figures):
        return results.markdown(["a", "b"], [[name, f"{value:.1f}"] for name, value in figures.items()])

    (tmp_path / results.FOLDER).mkdir(parents=True)
    results.report(None, {"x": 1.25}, table, root=tmp_path)
    assert capsys.readouterr().out == "| a | b |\n| --- | ---: |\n| x | 1.2 |\n"
    assert not list((tmp_path / results.FOLDER).iterdir())
    results.report("mine", {"x": 1.25}, table, root=tmp_path)
    assert results.read("mine", root=tmp_path) == {"x": 1.25}


def test_a_record_with_a_page_is_shown_there(tmp_path):
    (tmp_path / results.FOLDER).mkdir(parents=True)
    (tmp_path / "benchmarks" / "controls.md").write_text("<!-- controls: x -->\n<!-- end of controls -->\n")
    figures = {"boundaries": [["auto", 0.1, 0.08, 0.04]], "creases": [["auto", 0.1, 0.12, 0.13, 0.14]]}
    results.report("controls", figures, results.table_of("accuracy.controls.table"), root=tmp_path)
    assert "| `auto` | 0.1 | 0.12 | 0.13 | 0.14 |" in (tmp_path / "benchmarks" / "controls.md").read_text()
    assert json.loads((tmp_path / results.FOLDER / "controls.json").read_text()) == figures


def test_a_script_with_one_record_needs_no_name():
    parser = argparse.ArgumentParser()
    results.add_option(parser, "mine")
    assert parser.parse_args([]).record is None and parser.parse_args(["--record"]).record == "mine"
