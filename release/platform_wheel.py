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
import re
import subprocess
import sys
import sysconfig
import zipfile
from base64 import urlsafe_b64encode
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory

COMPILE = Path(__file__).with_name("compile_kernels.py")


def main(arguments: list[str] | None = None) -> None:
    """Make the wheel, and print its path."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("wheel", type=Path, help="the universal wheel")
    parser.add_argument("--output", type=Path, default=Path(), help="folder for the new wheel")
    parser.add_argument("--build", type=int, help="number of this build of the version")
    chosen = parser.parse_args(arguments)
    print(with_kernels(chosen.wheel, chosen.output, platform_tag(), build=chosen.build))


def with_kernels(wheel: Path, output: Path, tag: str, *, build: int | None = None, common: bool = False) -> Path:
    """Unpack a wheel, compile in what it unpacks to, check that nothing is left to compile, and pack; return the path.

    With `common`, only kernels of common commands are compiled, and that is not checked.
    """
    with TemporaryDirectory() as folder:
        site = Path(folder) / "site"
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(site)
        for words in [["--common"]] if common else [[], ["--check"]]:
            compile_kernels(site, *words)
        return packed(site, wheel.name, output, build, tag)


def local_wheel(wheel: Path) -> Path:
    """Write a wheel with the common kernels for this very system beside a universal wheel; return its path."""
    return with_kernels(wheel, wheel.parent, re.sub(r"[-.]", "_", sysconfig.get_platform()), common=True)


def compile_kernels(site: Path, *words: str) -> None:
    """Run release/compile_kernels.py with the package in a folder."""
    paths = [str(site), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths), "PYTHONDONTWRITEBYTECODE": "1"}
    subprocess.run([sys.executable, COMPILE, *words], cwd=site, env=environment, check=True)


def packed(site: Path, pure: str, output: Path, build: int | None, tag: str) -> Path:
    """Write the files of a folder, and their checksums, as a wheel for a platform and this Python; return its path."""
    name, version = pure.split("-")[:2]
    python = f"cp{sys.version_info.major}{sys.version_info.minor}"
    tag = f"{python}-{python}{getattr(sys, 'abiflags', '')}-{tag}"
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
