"""Compile the kernels of the installed package into its folder, where the next process finds them.

    python release/compile_kernels.py           # compiles for any processor of this kind, and keeps what was compiled
    python release/compile_kernels.py --check   # fails where a run still compiles something
    python release/compile_kernels.py --cache   # compiles for this processor, into the cache of kernels

Kernels are compiled as they are called: every method is run and every format is read once, on a small piece of a scan.
With `--common`, which is much faster, only the methods in COMMON, `inspect` and `compare` are run.
"""

import argparse
import gc
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numba
import numpy as np
from llvmlite.binding import get_process_triple
from numba.core import event

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.compute.shipped_kernels import KERNELS_FOLDER, PROCESSORS

SCAN, PART = (Path(cn.__file__).parent / "demo_data" / name / "noisy.ply" for name in ("scan", "part"))
FORMATS = ("ply", "obj", "off", "stl", "gltf", "glb")
FACES = 400
COMMON = ("auto", "cascade", "bilateral-normal")
"""Methods whose kernels are compiled with `--common`."""


def main(arguments: list[str] | None = None) -> None:
    """Compile, in a process of its own whose numba is set up for it; or check; or fill the cache."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    ways = parser.add_mutually_exclusive_group()
    ways.add_argument("--check", action="store_true", help="compile nothing, and fail where something is compiled")
    ways.add_argument("--cache", action="store_true", help="fill the cache of kernels instead")
    parser.add_argument("--common", action="store_true", help="compile only what common commands need")
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    chosen = parser.parse_args(arguments)
    if chosen.cache:
        exercise(common=chosen.common)
        return
    if chosen.here:
        work(chosen.check, common=chosen.common)
        return
    processor, _ = PROCESSORS[get_process_triple().partition("-")[0]]
    settings = {} if chosen.check else {"NUMBA_CPU_NAME": processor, "NUMBA_CPU_FEATURES": ""}
    with TemporaryDirectory() as folder:
        environment = os.environ | settings | {"NUMBA_CACHE_DIR": folder}
        done = subprocess.run([sys.executable, *sys.orig_argv[1:], "--here"], env=environment)
    raise SystemExit(done.returncode)


def work(check: bool, *, common: bool) -> None:
    """Call what compiles kernels; then keep them, or say which ones were compiled."""
    with compiled() as names:
        exercise(common=common)
    if not check:
        from cascadenorm.compute.kernel_cache import KernelCache

        for kept in [one for one in gc.get_objects() if type(one) is KernelCache]:
            kept.ship()
        sizes = [path.stat().st_size for path in KERNELS_FOLDER.iterdir()]
        print(f"{len(sizes)} kernels for {numba.config.CPU_NAME}, {sum(sizes) / 1e6:.1f} MB, in {KERNELS_FOLDER}")
    elif names:
        raise SystemExit(f"{len(names)} kernels do not come with the package:\n" + "\n".join(names))
    else:
        print("nothing was compiled")


@contextmanager
def compiled() -> Iterator[list[str]]:
    """List the functions that numba compiles inside the block, with the types of their arguments."""
    names: list[str] = []

    class Listener(event.Listener):  # type: ignore[misc]
        def on_start(self, event: Any) -> None:
            function = event.data["dispatcher"].py_func
            names.append(f"{function.__module__}.{function.__qualname__}{event.data['args']}")

        def on_end(self, event: Any) -> None:
            pass

    with event.install_listener("numba:compile", Listener()):
        yield names


def exercise(*, common: bool) -> None:
    """Denoise a piece of the shipped scan by each method and through each format, and inspect and measure it."""
    names = COMMON if common else [name for name in cn.methods() if name != "fairing"]  # needs a region; fills holes
    first = ["--method", "taubin"] if common else ["--boundary", "smooth", "--creases", "60"]
    second = ["--method", "taubin"] if common else ["--keep-detail", "4 edges", "--keep-volume"]
    with piece_of_scan() as piece:
        for choice in (
            *(f"--method={name}" for name in names),
            *(f"--set=treat_as={one}" for one in cn.methods()["auto"].settings["treat_as"].choices),
        ):
            _run("denoise", piece, choice, "--force")
        for format in FORMATS:
            other = piece.with_suffix(f".{format}")
            _run("denoise", piece, "-o", other, "--force", *first)
            _run("denoise", other, "--force", *second)
        _run("inspect", piece)
        _run("compare", piece, SCAN)
        if not common:
            _run("fill-holes", piece)
            _run("denoise-regions", piece, "--force")
            _run("spectrum", piece)
        _run("denoise", shuffled(piece))
        _run("denoise", PART, "-o", piece, "--force")  # a closed surface


@contextmanager
def piece_of_scan() -> Iterator[Path]:
    """Write the first faces of the scan into a temporary folder."""
    whole = cn.read(SCAN).mesh
    used, faces = np.unique(whole.faces[:FACES], return_inverse=True)
    with TemporaryDirectory() as folder:
        piece = Path(folder) / "piece.ply"
        cn.write(cn.from_arrays(whole.vertices[used], faces.reshape(-1, 3)), piece)
        yield piece


def shuffled(piece: Path) -> Path:
    """Write the whole scan with its faces in random order, which is put in order first, beside its piece."""
    whole, path = cn.read(SCAN).mesh, piece.with_name("shuffled.ply")
    cn.write(cn.from_arrays(whole.vertices, np.random.default_rng(0).permutation(whole.faces)), path)
    return path


def _run(*arguments: str | Path) -> None:
    if code := run(list(map(str, arguments))):
        raise SystemExit(code)


if __name__ == "__main__":
    main()
