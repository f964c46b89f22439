"""Run the commands of the Dockerfile where there is no Docker, in an empty folder that stands for the root.

    python container/replay.py FOLDER

What `.dockerignore` lets through is copied, variables are set and commands are run in their order, absolute paths below
the folder, in a fresh environment of Python; users are not made. Then the entry point denoises a scan from stdin.
"""

import argparse
import os
import re
import shlex
import shutil
import subprocess
import venv
from fnmatch import fnmatch
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
SCAN = REPOSITORY / "cascadenorm" / "demo_data" / "part" / "noisy.ply"
OF_USERS = ("useradd", "install -d -o")
"""Commands that are left out: there is one user."""


def main(arguments: list[str] | None = None) -> None:
    """Replay the Dockerfile below a folder, and use what it has made."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="made for it; it must be empty")
    root = parser.parse_args(arguments).folder.resolve()
    root.mkdir(parents=True, exist_ok=True)
    if any(root.iterdir()):
        raise SystemExit(f"{root} is not empty")
    entry = replay((REPOSITORY / "Dockerfile").read_text(encoding="utf-8"), root)
    done = subprocess.run([*entry, "denoise", "-"], input=SCAN.read_bytes(), stdout=subprocess.PIPE, check=True)
    print(f"denoised {SCAN.stat().st_size} bytes to {len(done.stdout)}")
    if done.stdout == SCAN.read_bytes() or not done.stdout.startswith(b"ply"):
        raise SystemExit("what came out is no denoised mesh")


def replay(text: str, root: Path) -> list[str]:
    """Follow the instructions of a Dockerfile; return the entry point."""
    venv.create(root / "python", with_pip=True)
    variables = {"PATH": f"{root / 'python' / 'bin'}{os.pathsep}{os.environ['PATH']}"}
    for line in text.replace("\\\n", " ").splitlines():
        word, _, rest = line.strip().partition(" ")
        if word == "ARG":
            name, _, value = rest.partition("=")
            variables[name] = value
        elif word == "ENV":
            values = [item.partition("=") for item in shlex.split(rest)]
            variables |= {name: below(root, expanded(value, variables)) for name, _, value in values}
        elif word == "COPY":
            source, target = rest.split()
            copy(REPOSITORY / source, Path(below(root, target)))
        elif word == "RUN":
            for command in rest.split("&&"):
                run(command.strip(), root, variables)
        elif word == "ENTRYPOINT":
            os.environ.update(variables)
            return [shutil.which(name) or name for name in re.findall(r'"([^"]+)"', rest)]
        elif word not in ("", "#", "FROM", "USER", "WORKDIR", "CMD"):
            raise SystemExit(f"the instruction {word} is not known here")
    raise SystemExit("the Dockerfile has no ENTRYPOINT")


def expanded(value: str, variables: dict[str, str]) -> str:
    """Put variables in the place of their names."""
    return re.sub(r"\$\{?(\w+)\}?", lambda name: variables.get(name[1], ""), value)


def below(root: Path, word: str) -> str:
    """Return a word with the absolute path in it, if there is one, below the root."""
    return re.sub(r"(?<![\w./])/(?=\w)", f"{root}/", word)


def run(command: str, root: Path, variables: dict[str, str]) -> None:
    """Run a command, unless it is about users."""
    if command.startswith(OF_USERS):
        print(f"left out: {command}")
        return
    print(f"run: {command}", flush=True)
    subprocess.run(below(root, command), shell=True, check=True, cwd=root, env={**os.environ, **variables})


def copy(source: Path, target: Path) -> None:
    """Copy what .dockerignore lets through: it leaves out everything but what it names with an exclamation mark."""
    lines = (REPOSITORY / ".dockerignore").read_text(encoding="utf-8").split()
    kept = [line[1:] for line in lines if line.startswith("!")]
    ignored = [line.removeprefix("**/") for line in lines if line.startswith("**/")]
    target.mkdir(parents=True)
    for name in kept:
        if (source / name).is_dir():
            shutil.copytree(source / name, target / name, ignore=lambda _, names: [
                one for one in names if any(fnmatch(one, pattern) for pattern in ignored)
            ])  # fmt: skip
        else:
            shutil.copy(source / name, target / name)


if __name__ == "__main__":
    main()
