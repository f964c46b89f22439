"""Compile the kernels of the installed package into its folder, where the next process finds them.

    python release/compile_kernels.py           # compiles for any processor of this kind, and keeps what was compiled
    python release/compile_kernels.py --check   # fails where a run still compiles something

Kernels are compiled as they are called: every method is run and every format is read once, on a small piece of a scan.
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

SCAN = Path(cn.__file__).parent / "demo_data" / "scan" / "noisy.ply"
FORMATS = ("ply", "obj", "off", "stl", "gltf", "glb")
FACES = 400


def main(arguments: list[str] | None = None) -> None:
    """Compile, in a process of its own whose numba is set up for it; or check."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="compile nothing, and fail where something is compiled")
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    chosen = parser.parse_args(arguments)
    if chosen.here:
        work(chosen.check)
        return
    processor, _ = PROCESSORS[get_process_triple().partition("-")[0]]
    settings = {} if chosen.check else {"NUMBA_CPU_NAME": processor, "NUMBA_CPU_FEATURES": ""}
    with TemporaryDirectory() as folder:
        environment = os.environ | settings | {"NUMBA_CACHE_DIR": folder}
        done = subprocess.run([sys.executable, *sys.orig_argv[1:], "--here"], env=environment)
    raise SystemExit(done.returncode)


def work(check: bool) -> None:
    """Run what compiles kernels; then keep them, or say which ones were compiled."""
    with compiled() as names:
        exercise()
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


def exercise() -> None:
    """Denoise a piece of the scan that comes with the package, by each method and through each format."""
    whole = cn.read(SCAN).mesh
    used, faces = np.unique(whole.faces[:FACES], return_inverse=True)
    with TemporaryDirectory() as folder:
        piece = Path(folder) / "piece.ply"
        cn.write(cn.from_arrays(whole.vertices[used], faces.reshape(-1, 3)), piece)
        for name in cn.methods():
            if name != "fairing":  # which needs a region: closing holes compiles its kernels
                _run("denoise", str(piece), "--method", name, "--force")
        _run("fill-holes", str(piece))
        for format in FORMATS:
            other = piece.with_suffix(f".{format}")
            _run("denoise", str(piece), "-o", str(other), "--force", "--boundary", "smooth", "--creases", "60")
            _run("denoise", str(other), "--force", "--keep-detail", "4 edges", "--keep-volume")
        _run("denoise-regions", str(piece), "--force")
        _run("inspect", str(piece))
        _run("spectrum", str(piece))
        _run("compare", str(piece), str(SCAN))
        shuffled = Path(folder) / "shuffled.ply"  # the whole, which is put in order first
        cn.write(cn.from_arrays(whole.vertices, np.random.default_rng(0).permutation(whole.faces)), shuffled)
        _run("denoise", str(shuffled), "--method", "bilateral-normal")


def _run(*arguments: str) -> None:
    if code := run(arguments):
        raise SystemExit(code)


if __name__ == "__main__":
    main()
