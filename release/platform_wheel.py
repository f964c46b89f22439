"""Make a wheel with compiled kernels, for this platform and this Python, from the universal wheel.

    pip install dist/cascadenorm-0.1.0-py3-none-any.whl         # for what the package needs
    python release/platform_wheel.py dist/cascadenorm-0.1.0-py3-none-any.whl --output dist

pip prefers such a wheel where it fits. Its kernels serve the releases of numba and llvmlite that are installed now;
with others the user compiles, as with the universal wheel. So after a release of numba make these wheels again with
`--build 1`, the next time 2: of two wheels of a version, pip takes the one with the larger number.
"""

import argparse
import os
import platform
import subprocess
import sys
import zipfile
from base64 import urlsafe_b64encode
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory

COMPILE = Path(__file__).with_name("compile_kernels.py")


def main(arguments: list[str] | None = None) -> None:
    """Unpack the wheel, compile in what it unpacks to, check that nothing is left to compile, and pack."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("wheel", type=Path, help="the universal wheel")
    parser.add_argument("--output", type=Path, default=Path(), help="folder for the new wheel")
    parser.add_argument("--build", type=int, help="number of this build of the version")
    chosen = parser.parse_args(arguments)
    with TemporaryDirectory() as folder:
        site = Path(folder) / "site"
        with zipfile.ZipFile(chosen.wheel) as archive:
            archive.extractall(site)
        for words in ([], ["--check"]):
            environment = os.environ | {"PYTHONPATH": str(site), "PYTHONDONTWRITEBYTECODE": "1"}
            subprocess.run([sys.executable, COMPILE, *words], cwd=folder, env=environment, check=True)
        print(packed(site, chosen.wheel.name, chosen.output, chosen.build))


def packed(site: Path, pure: str, output: Path, build: int | None) -> Path:
    """Write the files of a folder as a wheel for this platform, with the checksums in its table; return its path."""
    name, version = pure.split("-")[:2]
    python = f"cp{sys.version_info.major}{sys.version_info.minor}"
    tag = f"{python}-{python}{getattr(sys, 'abiflags', '')}-{platform_tag()}"
    about = site / f"{name}-{version}.dist-info"
    lines = [line for line in (about / "WHEEL").read_text(encoding="utf-8").splitlines() if line]
    lines = [line for line in lines if not line.startswith(("Tag:", "Root-Is-Purelib:", "Build:"))]
    lines += ["Root-Is-Purelib: false", *([f"Build: {build}"] if build else []), f"Tag: {tag}"]
    (about / "WHEEL").write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")

    path = output / "-".join([name, version, *([str(build)] if build else []), f"{tag}.whl"])
    table = about / "RECORD"
    table.unlink()
    rows = []
    with zipfile.ZipFile(path, "w") as archive:
        files = [one for one in site.rglob("*") if one.is_file()]
        for file in sorted(files, key=lambda one: (about in one.parents, one)):  # what it is about comes last
            content, place = file.read_bytes(), file.relative_to(site).as_posix()
            add(archive, place, content)
            digest = urlsafe_b64encode(sha256(content).digest()).rstrip(b"=").decode()
            rows.append(f"{place},sha256={digest},{len(content)}\n")
        place = table.relative_to(site).as_posix()
        add(archive, place, "".join([*rows, f"{place},,\n"]).encode())
    return path


def add(archive: zipfile.ZipFile, place: str, content: bytes) -> None:
    """Add a file that all may read, without the time at which it was made."""
    entry = zipfile.ZipInfo(place)
    entry.external_attr = 0o644 << 16
    archive.writestr(entry, content, zipfile.ZIP_DEFLATED)


def platform_tag() -> str:
    """Return the platform as wheels name it: the oldest one that has a numba, since there are no libraries in it."""
    machine = platform.machine().lower()
    systems = {"linux": "manylinux_2_17", "darwin": "macosx_11_0", "win32": "win"}
    return f"{systems[sys.platform]}_{machine}"


if __name__ == "__main__":
    main()
