"""Separate environments for other libraries, so that they do not change the environment of this project."""

import subprocess
import sys
import venv
from collections.abc import Sequence
from pathlib import Path


def interpreter(environment: Path, packages: Sequence[str]) -> Path:
    """Return the interpreter of an environment with the packages. The environment is created on first use."""
    python = environment / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    noted = environment / "installed.txt"
    if not python.exists():
        venv.create(environment, with_pip=True)
    installed = noted.read_text(encoding="utf-8").split() if noted.exists() else []
    missing = [package for package in packages if package not in installed]
    if missing:
        subprocess.run([python, "-m", "pip", "install", "--quiet", *missing], check=True)
        noted.write_text("\n".join([*installed, *missing]) + "\n", encoding="utf-8")
    return python
