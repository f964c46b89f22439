"""Links, names, commands and Python blocks in the documents are those that exist."""

import io
import json
import re
import shlex
import sys
from dataclasses import asdict, fields, replace
from functools import cache
from pathlib import Path
from textwrap import dedent
from urllib.parse import unquote, urlsplit

import pytest
from shapes import icosphere

import cascadenorm as cn
from benchmarks.accuracy.pairs import collect
from cascadenorm.api.api import methods
from cascadenorm.cli import run
from cascadenorm.evaluation import public_sets
from cascadenorm.evaluation.public_sets import PUBLIC_SETS, KnownPair, geometry_digest
from cascadenorm.io.interop import save_mesh
from cascadenorm.learned.config import TrainConfig
from cascadenorm.learned.stage import Stage
from cascadenorm.registry import methods as registry

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[2]
FOLDERS = (ROOT, ROOT / "docs", ROOT / "docs" / "how-to", ROOT / "benchmarks")
PAGES = sorted(page for folder in FOLDERS for page in folder.glob("*.md"))
GENERATED = ROOT / "docs" / "generated"
FENCE = re.compile(r"^( *)```.*?^\1```", re.MULTILINE | re.DOTALL)
NOT_RUN = "<!-- not run: "
"""Stands, with the reason, in the line before a Python block that a test cannot run."""

OF_OTHERS = {"__pycache__", "NUMBA_CACHE_DIR", "torchrun"}


def named(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def anchors(page: Path) -> set[str]:
    """The anchors that GitHub gives to the headings of a page."""
    headings = re.findall(r"^#+ (.+)$", FENCE.sub("", page.read_text(encoding="utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_links_lead_to_files_and_headings(page):
    for link in re.findall(r"\]\(([^)\s]+)\)", FENCE.sub("", page.read_text(encoding="utf-8"))):
        if link.startswith(("https://", "http://")):
            continue
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        if GENERATED in target.parents:
            continue  # the build of the site makes it, and warns of links that lead nowhere
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), f"{link}: {named(target)} has no such heading"


EXTERNAL = re.compile(r"\bhttps?:/+\w[^\s\[\]()<>`\"'\\\\]*", re.IGNORECASE)
DOI = re.compile(r"10\.\d{4,9}/[-\w.;:/]*\w")
OWN = re.compile(r"/github(?:\.com)?/OWNER/cascadenorm(?:/(?:blob|tree|raw)/[^/]+/([^#?]+))?")
WITH_LINKS = [*PAGES, *sorted((ROOT / "notebooks").glob("*.ipynb")), ROOT / "CITATION.cff", ROOT / "pyproject.toml"]


def external_links(text: str) -> list[str]:
    """Addresses in a text, without the punctuation that ends a sentence."""
    return [link.rstrip(".,;:!") for link in EXTERNAL.findall(text)]


def faults(link: str) -> list[str]:
    """What is wrong with the form of an external link, and with what it names of this repository."""
    parts = urlsplit(link)
    found = [] if parts.scheme == "https" else ["write https"]
    if not re.fullmatch(r"(?:[a-z0-9-]+\.)+[a-z]{2,}", parts.netloc):
        found.append("its host is no name")
    if "doi" in parts.netloc and not (parts.netloc == "doi.org" and DOI.fullmatch(parts.path[1:])):
        found.append("write https://doi.org/10.…/…")
    own = OWN.search(link)
    if own and own[1] and not (ROOT / unquote(own[1])).exists():
        found.append(f"the repository has no {own[1]}")
    return found


def spelled_alike(link: str) -> str:
    """What links have in common that lead to the same page."""
    return re.sub(r"^https?://(?:www\.)?|\.git$|/$", "", link.partition("#")[0].lower())


def test_faults_of_links_are_found():
    assert external_links("see (https://a.org/b), https://c.org/d. Or http://e.org; https://… is none") == [
        "https://a.org/b", "https://c.org/d", "http://e.org",
    ]  # fmt: skip
    good = ("https://doi.org/10.1145/2980179.2980232", "https://github.com/OWNER/cascadenorm/blob/main/docs/start.md#a")
    assert [faults(link) for link in good] == [[], []]
    for link in ("http://a.org", "https://localhost/x", "https://dx.doi.org/10.1145/1", "https://doi.org/doi:10.1145/1",
                 "https://doi.org/10.1145/", "https://github.com/OWNER/cascadenorm/tree/main/no/such"):  # fmt: skip
        assert len(faults(link)) == 1, link
    assert spelled_alike("https://www.A.org/b/") == spelled_alike("https://a.org/b.git#c") == "a.org/b"


def test_external_links_are_well_formed_and_each_has_one_spelling():
    """There is no network in tests, so that a page exists is not asked."""
    spellings: dict[str, set[str]] = {}
    for page in WITH_LINKS:
        for link in external_links(page.read_text(encoding="utf-8")):
            assert not faults(link), f"{named(page)}: {link}: {', '.join(faults(link))}"
            spellings.setdefault(spelled_alike(link), set()).add(link.partition("#")[0])
    assert len(spellings) > 15  # that links are found at all; no page names an address of this repository
    assert not [links for links in spellings.values() if len(links) > 1]


def test_the_architecture_names_only_what_exists():
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    folders_of_the_page = text[text.index("## Folders") : text.index("## Imports point one way")]
    for row in re.findall(r"^\|(.+)\|$", folders_of_the_page, re.MULTILINE)[2:]:
        where, _, modules = row.split("|")
        folders = [ROOT / name for name in re.findall(r"`([^`]+/)`", where)] or [ROOT / "cascadenorm"]
        for name in re.findall(r"`([^`<]+)`", modules):
            places = [folder.parent / name for folder in folders] + [folder / name for folder in folders]
            found = any(place.exists() or place.with_name(f"{name}.py").exists() for place in places)
            assert found, f"there is no {name} in{where}"


def test_the_text_of_the_architecture_names_only_what_exists():
    text = FENCE.sub("", (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8"))
    words = set(re.findall(r"[\w-]+", (ROOT / "pyproject.toml").read_text(encoding="utf-8")))
    folders = (ROOT / name for name in ("cascadenorm", "baselines", "data_gen", "docs"))
    for path in (path for folder in folders for path in folder.rglob("*.py")):
        words |= {path.stem, *re.findall(r'(?<=")[\w-]+|\w+', path.read_text(encoding="utf-8"))}
    for name in re.findall(r"`([A-Za-z_][\w./-]*)(?:\(…?\.*\))?`", text):
        if "/" in name or name.endswith((".py", ".ts")):
            sources = ROOT / "viewer" / "src"
            homes = (ROOT, ROOT / "cascadenorm", ROOT / "tests" / "helpers", sources, sources / "studio")
            assert any((home / name).exists() for home in homes) or name == "demo_data/", f"there is no file {name}"
        else:
            assert name in OF_OTHERS or set(name.split(".")) <= words, f"nothing is called {name}"


def blocks(text: str, language: str) -> list[str]:
    """The fenced blocks of a language, but those that are marked as not run."""
    fenced = rf"^([^\n]*)\n( *)```{language}\n(.*?)^\2```"
    found = re.findall(fenced, text, re.MULTILINE | re.DOTALL)
    return [dedent(block) for before, _, block in found if not before.strip().startswith(NOT_RUN)]


def command_lines(text: str) -> list[list[str]]:
    """What stands in shell blocks and, where it begins with the program, in code within a sentence."""
    spans = re.findall(r"`((?:cascadenorm|python) [^`\n]+)`", FENCE.sub("", text))
    lines = "\n".join([*blocks(text, "bash"), *spans]).replace("&&", "\n").splitlines()
    return [words for line in lines if (words := shlex.split(line, comments=True))]


@cache
def help_of(command: str) -> str:
    """The help of a command of the program; fails where there is none of that name."""
    with pytest.MonkeyPatch.context() as patch, io.StringIO() as text:
        patch.setattr(sys, "stdout", text)
        patch.setenv("COLUMNS", "200")
        assert run([command, "--help"]) == 0, f"there is no command {command}"
        return text.getvalue()


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_commands_and_scripts_exist_with_their_options(page):
    for words in command_lines(page.read_text(encoding="utf-8")):
        names = ["" if "://" in word else Path(word).name for word in words]  # no address is the program
        options = {word.partition("=")[0] for word in words if re.match(r"--?[a-z]", word)}
        if "cascadenorm" in names:
            arguments = words[names.index("cascadenorm") + 1 :]
            options &= set(arguments)
            command = arguments[0] if arguments and not arguments[0].startswith("-") else "--help"
            text = help_of(command)
        elif len(words) > 1 and words[1].endswith(".py"):
            text = (ROOT / words[1]).read_text(encoding="utf-8")
        elif words[1:2] == ["-m"] and words[2].startswith("benchmarks."):
            modules = (words[2], "benchmarks.results", "benchmarks.running")  # the last two have options of them all
            files = [ROOT / f"{module.replace('.', '/')}.py" for module in modules]
            text = "".join(file.read_text(encoding="utf-8") for file in files)
        else:
            continue
        for option in options:
            assert re.search(rf"(?<![\w-]){option}(?![\w-])", text), f"{shlex.join(words)}: there is no {option}"


@pytest.mark.parametrize("page", [page for page in PAGES if "```python" in page.read_text(encoding="utf-8")], ids=named)
def test_python_blocks_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(registry, "_methods", dict(registry._methods))
    (tmp_path / "scan.ply").write_bytes((ROOT / "cascadenorm" / "demo_data" / "scan" / "noisy.ply").read_bytes())
    names: dict[str, object] = {}
    for block in blocks(page.read_text(encoding="utf-8"), "python"):
        exec(compile(block, named(page), "exec"), names)
    assert page.name != "README.md" or (tmp_path / "smooth.ply").exists()
    assert page.name != "CONTRIBUTING.md" or "still" in methods()


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_public_names_and_extras_exist(page):
    text = page.read_text(encoding="utf-8")
    for name in re.findall(r"\bcn\.([A-Za-z]\w*)", text):
        assert hasattr(cn, name), f"there is no cascadenorm.{name}"
    for names in re.findall(r"(?:cascadenorm|\.)\[([\w,]+)\]", text):
        assert set(names.split(",")) <= extras(), f"there is no extra {names}"


def extras() -> set[str]:
    with (ROOT / "pyproject.toml").open("rb") as file:
        return set(tomllib.load(file)["project"]["optional-dependencies"])


def test_the_page_of_the_installation_names_every_extra():
    text = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE)) >= extras() - {"dev"}


def test_the_page_of_the_data_names_the_files_of_the_public_sets():
    page = (ROOT / "docs" / "data.md").read_text(encoding="utf-8")
    for name, pair in PUBLIC_SETS["guided"].listed.items():
        assert re.search(rf"^\| {name} \|.*\| `{pair.noisy}` \| `{pair.clean}` \|", page, re.MULTILINE), name
    assert PUBLIC_SETS["mesh-tgv"].listed["kinect_cone"].noisy in page
    for name, one in PUBLIC_SETS.items():
        assert f"`{name}`" in page and one.place.rpartition("https://github.com/")[2].split(",")[0] in page


def test_the_pairs_of_the_readme_are_collected_from_clones(tmp_path, monkeypatch):
    for name in ("n.obj", "c.obj"):
        save_mesh(tmp_path / name, icosphere(1))
    digest = geometry_digest(tmp_path / "n.obj")
    of = {name: replace(one, listed={}) for name, one in PUBLIC_SETS.items()}
    of["guided"].listed["ball"] = KnownPair("n.obj", "c.obj", (digest, digest))
    monkeypatch.setattr(public_sets, "PUBLIC_SETS", of)
    collect(tmp_path, tmp_path, tmp_path / "pairs")
    assert (tmp_path / "pairs" / "ball" / "clean.obj").read_bytes() == (tmp_path / "c.obj").read_bytes()
    save_mesh(tmp_path / "c.obj", icosphere(2), force=True)
    with pytest.raises(cn.ReadError, match=r"c\.obj differs from the published mesh: get it again: git clone"):
        collect(tmp_path, tmp_path, tmp_path / "pairs")


def test_the_training_page_lists_every_setting_with_its_default():
    text = (ROOT / "docs" / "training.md").read_text(encoding="utf-8")
    found = dict(re.findall(r"^\| `([\w.]+)` \| (.+?) \|", text, re.MULTILINE))
    config = asdict(TrainConfig())
    config["stages"] = {f.name: f.default for f in fields(Stage) if f.name != "descriptor"}
    flat = {
        f"{key}.{name}" if name else key: inner
        for key, value in config.items()
        for name, inner in (value.items() if isinstance(value, dict) else [("", value)])
    }
    assert set(found) >= set(flat)
    for key, value in flat.items():
        listed = f"{len(value)} names" if key in ("data.families", "data.noise_kinds") else f"{json.dumps(value)}"
        assert found[key].strip("`") == listed, key
