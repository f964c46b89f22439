"""What is released agrees with the package: recipe, tag, versions; and is well made: sdist, wheel."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.cli.demo import EXAMPLES, METHODS

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
WORKFLOW, TESTS = ((ROOT / ".github" / "workflows" / f"{name}.yml").read_text("utf-8") for name in ("release", "tests"))
CONDA = {"matplotlib": "matplotlib-base", "torch": "pytorch"}
"""Packages that conda-forge calls otherwise."""


def requirements(texts):
    """Name → bounds, as conda writes them; what another Python needs is needed by all there."""
    found = {}
    for text in texts:
        name, bounds = re.fullmatch(r"([\w.-]+?)\s*((?:[<>=!]=?[\w.]+,?)*)", text.partition(";")[0].strip()).groups()
        found[CONDA.get(name, name).lower()] = ",".join(sorted(bounds.split(","), reverse=True))
    return found


@pytest.fixture(scope="module")
def recipe():
    """The recipe, rendered as rattler-build does for conda-forge."""
    rattler_build = pytest.importorskip("rattler_build")
    (variant,) = rattler_build.Stage0Recipe.from_file(ROOT / "recipe" / "recipe.yaml").render()
    return variant.recipe.to_dict()


def test_the_recipe_asks_for_what_the_package_asks_for(recipe):
    assert recipe["package"] == {"name": "cascadenorm", "version": cn.__version__}
    asked = [text.replace(" ", "", 1) for text in recipe["requirements"]["run"]]
    wanted = requirements([*PROJECT["dependencies"], f"python{PROJECT['requires-python']}"])
    assert requirements(asked) == wanted
    extras = PROJECT["optional-dependencies"]
    users = [text for name in ("formats", "pyvista", "train") for text in extras[name] if "[" not in text]
    limits = requirements([text.replace(" ", "", 1) for text in recipe["requirements"]["run_constraints"]])
    assert limits == {name: bounds for name, bounds in requirements(users).items() if name != "tqdm"}


def test_the_recipe_tests_commands_that_exist(recipe, capsys):
    (commands,) = [test["script"] for test in recipe["tests"] if "script" in test]
    for command in commands:
        word = command.split()[1]
        assert run([word, *([] if word.startswith("-") else ["--help"])]) == 0, f"{command}: {capsys.readouterr().err}"
    (inspected,) = [command.split()[-1] for command in commands if " inspect " in command]
    assert Path(inspected) in {Path("demo", name, f"{method}.ply") for name in EXAMPLES for method in METHODS}
    script = PROJECT["scripts"]["cascadenorm"]
    assert recipe["build"]["python"]["entry_points"] == [f"cascadenorm = {script}"]


@pytest.mark.skipif(not shutil.which("bash"), reason="bash is not installed")
@pytest.mark.parametrize(("tag", "code"), [(f"v{cn.__version__}", 0), ("v99.0.0", 1), (cn.__version__, 1)])
def test_a_tag_that_is_not_the_version_is_refused(tag, code):
    line = re.search(r"is the version of the package\n +run: (.+)", WORKFLOW)[1]
    done = subprocess.run(["bash", "-c", line], cwd=ROOT, env={"GITHUB_REF_NAME": tag, "PATH": "/usr/bin:/bin"})
    assert done.returncode == code


@pytest.mark.skipif(not shutil.which("bash"), reason="bash is not installed")
def test_nothing_is_released_before_the_address_is_known():
    line = re.search(r"address of the repository is set\n +run: \"(.+)\"", WORKFLOW)[1]
    done = subprocess.run(["bash", "-c", line], cwd=ROOT, stdout=subprocess.DEVNULL)
    assert done.returncode == ("/OWNER/" in PROJECT["urls"]["Repository"])


def test_the_address_of_the_repository_stands_in_one_place():
    folders = (ROOT, *(ROOT / name for name in ("docs", "docs/how-to", "notebooks", "examples", "release")))
    files = [path for folder in folders for path in folder.iterdir() if path.is_file()]
    naming = [path for path in files if b"OWNER/cascadenorm" in path.read_bytes()]
    assert [path.name for path in naming] == ["pyproject.toml"]
    address = PROJECT["urls"]["Repository"].encode()
    assert not [path for path in files if path.suffix in (".md", ".ipynb") and address in path.read_bytes()]


def test_the_readme_has_one_command_for_the_main_job_and_one_for_the_tests():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    commands = [line for line in readme.splitlines() if line.startswith("python3 -m venv ")]
    install = "python3 -m venv .venv && .venv/bin/pip install -e "
    assert commands[0] == f"{install}. && .venv/bin/cascadenorm demo"
    assert commands[1] == f'{install}".[dev]" && .venv/bin/python -m pytest'
    assert commands[1] in (ROOT / ".ci" / "run").read_text(encoding="utf-8")  # where it runs in a clean environment
    steps = re.findall(r"- run: (.+)", TESTS)  # which have an environment already
    developing = 'pip install -e ".[dev]"'
    assert steps == [developing, "python -m pytest", developing, "python -m pytest -m slow"]


def test_pull_requests_are_tested_on_each_system_of_the_wheels():
    systems = {re.sub(r"-\d.*|-latest", "", name) for name in re.search(r"os: \[(.+)\]", WORKFLOW)[1].split(", ")}
    assert {name.removesuffix("-latest") for name in re.search(r"os: \[(.+)\]", TESTS)[1].split(", ")} == systems
    assert "pull_request:" in TESTS


def test_scripts_of_the_workflow_exist_and_only_one_job_may_publish():
    scripts = re.findall(r"python (\S+\.py)", WORKFLOW)
    assert scripts and all((ROOT / name).exists() for name in scripts)
    jobs = re.split(r"\n  (?=\w+:\n    )", WORKFLOW.partition("\njobs:")[2])
    trusted = [job for job in jobs if "id-token: write" in job]
    assert len(trusted) == 1 and "pypa/gh-action-pypi-publish" in trusted[0] and "checkout" not in trusted[0]


def test_completion_of_commands_and_options_for_shells():
    run = [sys.executable, "-m", "cascadenorm"]
    for words, expected in (
        ("cascadenorm den", "denoise\ndenoise-regions"),
        ("cascadenorm denoise --stre", "--strength"),
    ):
        asked = {"_CASCADENORM_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
        done = subprocess.run(run, env=asked, capture_output=True, text=True, check=True)
        assert done.stdout.strip() == expected
