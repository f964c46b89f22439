"""Build what is released, and check it as a user would install it.

    python release/check.py               # into dist/: sdist, wheel, bill of materials; pip install twine … first
    python release/check.py --output DIR

1. An sdist is built, and a wheel from the sdist, so that nothing of the checkout gets into the wheel.
2. `twine check --strict` and `check-wheel-contents` look at both.
3. The wheel is installed into a fresh environment, and used from another folder: the program, the typed package, tests.
4. What that environment holds is written down as a bill of materials, in the format CycloneDX.

Needs `build`, `twine`, `check-wheel-contents` and `cyclonedx-bom`: `pip install "cascadenorm[dev]"` has them.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TESTS = ("api/test_api", "api/test_selection", "geometry/test_metrics", "io/test_interop")
"""Tests that need nothing of the checkout but the folder of the tests."""


def main(arguments: list[str] | None = None) -> None:
    """Build, check, install, test, and write the bill of materials; the first failure ends it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=ROOT / "dist", help="folder for the files; it is emptied first")
    output = parser.parse_args(arguments).output.resolve()
    shutil.rmtree(output, ignore_errors=True)
    sdist, wheel = built(output)
    run("twine", "check", "--strict", sdist, wheel)
    run("check_wheel_contents", wheel)
    with tempfile.TemporaryDirectory() as folder:
        python = installed(Path(folder), wheel)
        used(python, Path(folder))
        # the tests' own packages come after the bill of materials, which they are no part of
        run("cyclonedx_py", "environment", python, "--output-file", output / "sbom.cdx.json", "--output-reproducible")
        tested(python, Path(folder))
    for path in sorted(output.iterdir()):
        print(f"{path}: {path.stat().st_size / 1e6:.2f} MB")


def built(output: Path) -> tuple[Path, Path]:
    """Build the sdist, and the universal wheel from it."""
    run("build", "--config-setting", "kernels=none", "--outdir", output, ROOT, stdout=subprocess.DEVNULL)
    return next(output.glob("*.tar.gz")), next(output.glob("*.whl"))


def installed(folder: Path, wheel: Path) -> Path:
    """Install a wheel into a fresh environment; return its Python."""
    venv.create(folder / "venv", with_pip=True)
    python = folder / "venv" / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    subprocess.run([python, "-m", "pip", "install", "--quiet", wheel], check=True)
    return python


def used(python: Path, folder: Path) -> None:
    """Use the program from a folder that is not the checkout."""
    program = [python, "-m", "cascadenorm"]
    subprocess.run([*program, "demo", folder / "demo"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    scan = folder / "scan.ply"
    shutil.copy(ROOT / "cascadenorm" / "demo_data" / "part" / "noisy.ply", scan)
    subprocess.run([*program, "denoise", scan], cwd=folder, check=True)
    subprocess.run([*program, "inspect", folder / "scan_denoised.ply"], cwd=folder, check=True)


def tested(python: Path, folder: Path) -> None:
    """Run tests on the installed package."""
    shutil.copytree(ROOT / "tests", folder / "tests", ignore=shutil.ignore_patterns("__pycache__"))
    subprocess.run([python, "-m", "pip", "install", "--quiet", "pytest", "hypothesis"], check=True)
    files = [f"tests/{name}.py" for name in TESTS]
    subprocess.run([python, "-m", "pytest", "-q", "-p", "no:cacheprovider", *files], cwd=folder, check=True)


def run(module: str, *words: object, stdout: int | None = None) -> None:
    """Run a module of this Python."""
    subprocess.run([sys.executable, "-m", module, *map(str, words)], check=True, stdout=stdout)


if __name__ == "__main__":
    main()
