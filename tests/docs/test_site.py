"""What the documentation site is made of: pages from the registry, the command line and the weights; tasks that run."""

import importlib
import itertools
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from shapes import grid, icosphere, noisy
from test_docs import blocks, help_of

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.io.interop import save_mesh
from cascadenorm.learned.methods import weights_file
from cascadenorm.registry import Parameter, Setting

DOCS = Path(__file__).parents[2] / "docs"
sys.path.insert(0, str(DOCS / "extensions"))
sys.path.insert(0, str(DOCS / "generate"))
import card_pages  # noqa: E402
import check_site  # noqa: E402
import command_line  # noqa: E402
import docstrings  # noqa: E402
import method_pages  # noqa: E402


def test_every_method_has_a_page_with_formula_and_limits():
    for name, method in cn.methods().items():
        if method.family == "own":  # registered by a test
            continue
        formula, limits = method.section("Formula"), method.section("Limits")
        assert "←" in formula or "=" in formula or "minimise" in formula, name
        assert limits.endswith("."), name
        assert not set(limits) & set("←Σ"), name


def test_the_page_of_a_method_has_what_the_registry_says():
    shown = {shape: one.noisy for shape, one in method_pages.examples().items()}
    page = method_pages.method_page(cn.methods()["taubin"], shown)
    assert page.startswith("# taubin\n\nAlternate steps λ > 0 and μ < 0")
    assert "**Source:** Taubin 1995" in page
    assert "1/λ + 1/μ = k_PB" in page.split("## Formula")[1].split("```")[1]
    assert "| `pass_band` | Pass-band eigenvalue k_PB, kept unchanged | `0.1` |  | above 0, below 2 |" in page
    noisy_row, result_row = re.findall(r"^\| (?:noisy|taubin) \|.*$", page, re.MULTILINE)
    assert noisy_row.split("|")[2:] == result_row.split("|")[2:]  # the meshes that were given are the noisy ones


def test_the_examples_of_the_pages_are_noisy():
    for name, (rough, clean) in method_pages.examples().items():
        assert np.array_equal(rough.faces, clean.faces), name
        assert cn.compare(rough, clean).normal_error_deg > 15, name


def test_allowed_values_are_choices_or_a_range():
    about = Parameter("of it", minimum=0, below=2)
    assert method_pages.allowed(Setting("a", float, 1.0, about)) == "at least 0, below 2"
    assert method_pages.allowed(cn.methods()["l0"].settings["operator"]) == "`area`, `cotan`"


def test_sections_of_a_docstring():
    method = cn.methods()["fairing"]
    assert method.section("Formula") == "Δ^p x = 0 inside the region,   x given outside,   p the order"
    assert method.section("Raises").startswith("ParameterError\n    No region is given")
    assert method.section("").startswith(method.summary)
    assert method.section("Nothing") == ""


def test_the_page_of_commands_has_every_command_and_option():
    page = command_line.PAGE.read_text(encoding="utf-8")
    assert page == command_line.command_page(), "run python docs/generate/command_line.py"
    *commands, controls = page.split("\n## ")[1:]
    sections = dict(zip(command_line.names(), commands, strict=True))
    assert next(iter(sections)) == "denoise"  # what most come for
    usages = re.findall(r"^cascadenorm (.*?) \[OPTIONS\]$", page, re.MULTILINE)
    assert {"inspect IN", "models [MODEL]", "train-gate VERTEX SURFACE"} <= set(usages)  # optional in brackets
    explained = spelled("\n".join(re.findall(r"^\| `(-.*?)` \|", controls, re.MULTILINE)))
    for name, section in sections.items():
        assert section.startswith(f"`{name}`\n")
        rows = re.findall(r"^\| `(-.*?)` \|", section, re.MULTILINE)
        named = spelled(
            "\n".join(re.findall(r"^It also has the \[controls\]\(#controls\) (.*)\.$", section, re.MULTILINE))
        )
        assert named <= explained
        listed = spelled("\n".join(rows)) | named
        known = spelled("\n".join(re.findall(r"^│ [* ]*((?:--?[a-z][\w-]*[ ,]*)+)", help_of(name), re.MULTILINE)))
        assert listed == known - {"--help"}, name


def spelled(text: str) -> set[str]:
    """The options in a text."""
    return set(re.findall(r"(?<![\w-])--?[a-z][\w-]*", text))


def test_the_page_of_model_cards_has_every_setting():
    page = card_pages.card_page()
    auto = cn.Denoiser.shipped("auto").card
    cards = {"`auto`, vertex network": auto["vertex"], "`auto`, surface network": auto["surface"]}
    for title, card in {**cards, "`cascade`": cn.Denoiser.shipped("cascade").card}.items():
        section = page.split(f"## {title}\n")[1].split("\n## ")[0]
        assert f"{card['faces_trained_on']:,}" in section
        assert f"| `seed` | `{card['config']['seed']}` |" in section
        assert f"| `fit.hidden` | `{card['config']['fit']['hidden']}` |" in section
        assert card["config"]["data"]["families"][0] in section
    assert f"| all | {auto['gate']['mean_angles_deg']['all']['vertex']:.2f} |" in page


def test_the_python_reference_has_every_public_name():
    page = (DOCS / "api.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"^   (\w+)$", page, re.MULTILINE)) == sorted(cn.__all__)


def test_links_of_a_site_are_checked(tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "a.html").write_text('<h2 id="x">X</h2><a href="sub/b.html#y">b</a><a href="https://example.org">e</a>')
    (tmp_path / "sub" / "b.html").write_text('<p id="y"><a href="../a.html#x">a</a><img src="../p.png"></p>')
    (tmp_path / "p.png").write_bytes(b"")
    assert check_site.faults(tmp_path) == []
    check_site.read.cache_clear()
    (tmp_path / "a.html").write_text('<a href="sub/c.html">c</a><a href="http://e.org">e</a><script src="//cdn/x.js">')
    assert check_site.faults(tmp_path) == [
        "a.html: loads //cdn/x.js, which is elsewhere",
        "a.html: links to sub/c.html, which does not exist",
        "a.html: links to http://e.org; write https://",
        "sub/b.html: links to ../a.html#x, but there is no such heading",
    ]


def test_every_page_is_in_a_table_of_contents():
    def listed(page):
        trees = re.findall(r"```{toctree}\n(?::.*\n)*\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
        return {(page.parent / f"{name}.md").resolve() for tree in trees for name in tree.split()}

    known = {page for index in DOCS.rglob("*.md") if "generated" not in index.parts for page in listed(index)}
    for page in sorted(
        [*DOCS.glob("*.md"), *(DOCS / "how-to").glob("*.md"), *(DOCS.parent / "benchmarks").glob("*.md")]
    ):
        assert page in known or page.name == "index.md", (
            f"name {page.name} in the table of docs/reference.md or another"
        )


def test_stars_and_underscores_of_docstrings_stand_for_themselves():
    assert (
        docstrings.plain("all of **/*.ply in `a_*`, |x_i|, model_") == r"all of \*\*/\*.ply in `a_*`, \|x_i\|, model\_"
    )


def test_types_of_arrays_are_links_to_what_numpy_and_others_have():
    """The build finds a name in the inventories, and the inventories have no name that does not exist."""
    assert docstrings.plain("(n, 3) float64, `float64`") == "(n, 3) :class:`float64 <numpy.float64>`, `float64`"
    listed = [path.read_text(encoding="utf-8").splitlines() for path in (DOCS / "inventories").glob("*.inv")]
    names = [line.split()[0] for lines in listed for line in lines if not line.startswith("#")]
    assert {"numpy.ndarray", "numpy.float64", "scipy.sparse.linalg.eigsh", "torch.optim.AdamW"} <= set(names)
    for name in names:
        module, _, last = name.rpartition(".")
        assert hasattr(importlib.import_module(module), last), name


def test_entries_of_docstrings_become_definitions():
    given = [
        "Do it.", "", "Parameters", "----------", "a, b", "    two", "    numbers", "c", "    text", "",
        "Returns", "-------", "One", "more",
    ]  # fmt: skip
    made = docstrings.with_definitions(given)
    assert made[:2] == ["Do it.", ""]
    assert made[3:10] == [".. rubric:: Parameters", "", "``a, b``", "    two", "    numbers", "``c``", "    text"]
    assert made[-5:] == [".. rubric:: Returns", "", "One", "more", ""]


ROOT = DOCS.parent
PAGES = [ROOT / "README.md", *sorted(DOCS.glob("*.md")), *sorted((DOCS / "how-to").glob("*.md"))]
WITH_COMMANDS = [page for page in PAGES if "cascadenorm " in "".join(blocks(page.read_text(encoding="utf-8"), "bash"))]
ELSEWHERE = {
    r"train |generate ": "takes minutes to hours: test_models.py and test_training_pairs.py do so with less data",
    r"studio ": "serves until its page is closed: test_studio.py",
    r"batch .*--watch": "runs until it is interrupted: test_watching.py",
    r"evaluate --dataset \S+ --from": "needs a copy of a public set: test_public_sets.py makes one",
}
"""Commands of the pages that run in other tests, and why."""
TOOL = f"""#!{sys.executable}
import shutil, sys
shutil.copy(sys.argv[2], sys.argv[4])
"""


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    """A folder with the files and the programs that the pages name, all small."""
    monkeypatch.chdir(tmp_path)
    ball = noisy(icosphere(3), 0.1)
    names = "part.stl part.ply statue.ply scan.ply scan.obj scan.glb organ.stl model.stl noisy.ply huge.ply a.ply b.ply"
    for name in (*names.split(), "scans/a.ply", "my_pairs/bolt/noisy.ply", "held_out/flange/noisy.ply"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        save_mesh(tmp_path / name, ball)
    for name in ("clean.ply", "truth.ply", "result.ply", "my_pairs/bolt/clean.ply", "held_out/flange/clean.ply"):
        save_mesh(tmp_path / name, icosphere(3))
    for name in ("open.ply", "depth.ply", "terrain.ply"):
        save_mesh(tmp_path / name, noisy(grid(12, 12), 0.1))
    for name, shift in (("left.ply", 0.0), ("right.ply", 3.0)):
        save_mesh(tmp_path / name, ball.moved(ball.vertices + np.array([shift, 0, 0])))
    (tmp_path / "folder_of_their_meshes").mkdir()
    save_mesh(tmp_path / "folder_of_their_meshes" / "bolt.ply", icosphere(3))
    (tmp_path / "mask.txt").write_text("0.5\n" * len(ball.vertices))
    np.save(tmp_path / "dent.npy", ball.vertices[:, 2] > 0.8)
    shutil.copy(weights_file("cascade"), tmp_path / "mine.safetensors")
    passed = {"stage": 1, "cluster": 1, "epoch": 1, "loss": 0.2, "validation": 0.2, "validation_deg": 9}
    (tmp_path / "quick.jsonl").write_text(json.dumps(passed) + "\n")
    (tmp_path / "programs").mkdir()
    program = f'#!/bin/sh\nexec "{sys.executable}" -m cascadenorm "$@"\n'
    for name, text in (("denoise-tool", TOOL), ("cascadenorm", program)):
        (tmp_path / "programs" / name).write_text(text)
        (tmp_path / "programs" / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path / 'programs'}{os.pathsep}{os.environ['PATH']}")
    return tmp_path


def exit_code(line):
    """Run a line of a page if it is a command of the program; 0 if it is not."""
    words = shlex.split(line, comments=True)
    command = shlex.join(words[1:])
    if "|" in words and "cascadenorm" in words:
        return subprocess.run(["sh", "-e", "-c", line]).returncode
    if words[:1] != ["cascadenorm"] or any(re.match(pattern, command) for pattern in ELSEWHERE):
        return 0
    for place in range(len(words) - 1):  # processes take seconds to start: the tests of batch and evaluate start some
        if words[place] == "--workers":
            words[place + 1] = "1"
    if "--turntable" in words:  # the pictures are many
        words += ["--size", "64"]
    outputs = [after for before, after in itertools.pairwise(words) if before in ("-o", "--output")]
    for name in ("report.html", "scan_denoised.ply", *outputs):  # pages show several commands that write the same
        if Path(name).is_file():
            Path(name).unlink()
    return run(words[1:])


@pytest.mark.parametrize("page", WITH_COMMANDS, ids=lambda page: page.stem)
def test_commands_of_pages_run(page, workplace, capsys):
    for line in "\n".join(blocks(page.read_text(encoding="utf-8"), "bash")).splitlines():
        assert exit_code(line) == 0, f"{line}: {capsys.readouterr().err}"


def test_the_examples_of_the_page_of_a_method_run(workplace, capsys):
    mesh = cn.read("scan.ply").mesh
    for method in (one for one in cn.methods().values() if one.family != "own"):
        page = "\n" + method_pages._use(method)
        for line in blocks(page, "bash")[0].splitlines():
            assert exit_code(line) == 0, f"{line}: {capsys.readouterr().err}"
        exec(blocks(page, "python")[0], {"cn": cn, "mesh": mesh, "dent": np.load("dent.npy")})
