"""Build the extension of Blender: one zip for a platform, with the wheels that it needs.

    python release/blender/build.py                             # for this platform, Blender 4.2 to 5.0
    python release/blender/build.py --python 3.13 --platform windows-x64 macos-arm64 --output dist

Wheels of other projects come from PyPI, as they are there; numpy is Blender's own. The size of each zip is printed.
"""

import argparse
import platform
import shutil
import subprocess
import sys
import tempfile
import zipfile
from email import message_from_bytes
from email.message import Message
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MANIFEST = ROOT / "release" / "blender" / "blender_manifest.toml"

VERSIONS = {"3.11": ("4.2.0", "5.1.0"), "3.13": ("5.1.0", "")}
"""Versions of Blender with each version of Python: from this one, and up to, but not including, that one."""

PACKAGES = {
    "3.11": [
        "llvmlite==0.44.0",
        "numba==0.61.2",
        "scipy==1.15.3",
        "orjson>=3.10.6",
        "safetensors>=0.4",
        "threadpoolctl>=3.1",
    ],
    "3.13": ["llvmlite", "numba>=0.62", "scipy>=1.15", "orjson>=3.10.6", "safetensors>=0.4", "threadpoolctl>=3.1"],
}
"""What denoising imports. Blender 4.2 has numpy 1.24, which these releases, and none that are much newer, support."""

TAGS = {
    "linux-x64": [f"manylinux_2_{minor}_x86_64" for minor in (28, 27, 17)] + ["manylinux2014_x86_64"],
    "macos-arm64": [f"macosx_{major}_0_arm64" for major in (14, 13, 12, 11)],
    "macos-x64": [
        f"macosx_{version}_x86_64" for version in ("14_0", "13_0", "12_0", "11_0", "10_14", "10_13", "10_12")
    ],
    "windows-x64": ["win_amd64"],
    "windows-arm64": ["win_arm64"],
}
"""Tags of wheels, by the name that Blender gives to a platform."""


def main(arguments: list[str] | None = None) -> None:
    """Build a zip for each platform that was named, and print its size."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--platform", nargs="+", choices=TAGS, default=[this_platform()])
    parser.add_argument("--python", choices=VERSIONS, default="3.11", help="3.11 for Blender 4.2 to 5.0, 3.13 from 5.1")
    parser.add_argument("--output", type=Path, default=ROOT / "dist", help="folder for the zips")
    given = parser.parse_args(arguments)
    given.output.mkdir(parents=True, exist_ok=True)
    for name in given.platform:
        with tempfile.TemporaryDirectory() as folder:
            wheels = own_wheel(Path(folder)) + downloaded(Path(folder), name, given.python)
            path = packed(wheels, name, given.python, given.output)
        print(f"{path}: {path.stat().st_size / 1e6:.0f} MB")


def this_platform() -> str:
    """Return what Blender calls this platform."""
    system = {"Linux": "linux", "Darwin": "macos", "Windows": "windows"}[platform.system()]
    return f"{system}-{'arm64' if platform.machine().lower() in ('arm64', 'aarch64') else 'x64'}"


def own_wheel(folder: Path) -> list[Path]:
    """Build the universal wheel of this package."""
    shutil.rmtree(ROOT / "build", ignore_errors=True)  # of an earlier build, whose files would get in
    words = ["--quiet", "--no-deps", "--config-settings", "kernels=none", "--wheel-dir", str(folder / "own"), str(ROOT)]
    subprocess.run([sys.executable, "-m", "pip", "wheel", *words], check=True)
    return list((folder / "own").glob("*.whl"))


def downloaded(folder: Path, name: str, python: str) -> list[Path]:
    """Download the wheels of other packages for a platform and a version of Python."""
    tags = [word for tag in TAGS[name] for word in ("--platform", tag)]
    run = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary", ":all:"]
    run += ["--python-version", python, "--implementation", "cp", *tags, "--dest", str(folder / "other")]
    if subprocess.run([*run, *PACKAGES[python]]).returncode:
        raise SystemExit(f"PyPI has no wheels of {', '.join(PACKAGES[python])} for {name} and Python {python}")
    return sorted((folder / "other").glob("*.whl"))


def packed(wheels: list[Path], name: str, python: str, output: Path) -> Path:
    """Write the extension with its wheels, its manifest and what their licences are; return the path of the zip."""
    first, end = VERSIONS[python]
    path = output / f"cascadenorm-blender-{first.rpartition('.')[0]}-{name}.zip"
    listed = "".join(f'    "./wheels/{wheel.name}",\n' for wheel in wheels)
    own, permissions = MANIFEST.read_text(encoding="utf-8").split("\n[", 1)
    versions = f'blender_version_min = "{first}"\n' + (f'blender_version_max = "{end}"\n' if end else "")
    manifest = f'{own}{versions}platforms = ["{name}"]\nwheels = [\n{listed}]\n\n[{permissions}'
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("blender_manifest.toml", manifest)
        archive.writestr("LICENSES.md", licences(wheels))
        archive.write(ROOT / "release" / "blender" / "__init__.py", "__init__.py")
        archive.write(ROOT / "LICENSE", "LICENSE")
        for wheel in wheels:
            archive.write(wheel, f"wheels/{wheel.name}", zipfile.ZIP_STORED)
    return path


def licences(wheels: list[Path]) -> str:
    """Return a page with the licence that each wheel states; the texts lie in the wheels."""
    rows = []
    for data in map(metadata, wheels):
        named = [line.rpartition(" :: ")[2] for line in data.get_all("Classifier", []) if line.startswith("License ::")]
        stated = data["License-Expression"] or "; ".join(named) or (data["License"] or "see the wheel").splitlines()[0]
        rows.append(f"| {data['Name']} | {data['Version']} | {stated} |")
    head = "# Licences of the bundled wheels\n\nThe texts lie in the folder `*.dist-info` of each.\n\n"
    return head + "| package | version | licence |\n| --- | --- | --- |\n" + "\n".join(rows) + "\n"


def metadata(wheel: Path) -> Message:
    """Return what a wheel states about itself."""
    with zipfile.ZipFile(wheel) as archive:
        (name,) = [name for name in archive.namelist() if name.endswith(".dist-info/METADATA")]
        return message_from_bytes(archive.read(name))


if __name__ == "__main__":
    main()
