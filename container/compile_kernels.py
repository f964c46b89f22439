"""Run every method and read every format once, so that all kernels are compiled and kept for those who come later."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import cascadenorm as cn
from cascadenorm.cli import run

SCAN = Path(cn.__file__).parent / "demo_data" / "scan" / "noisy.ply"
FORMATS = ("ply", "obj", "off", "stl", "gltf", "glb")
FACES = 400


def main() -> None:
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
        _run("inspect", str(piece))
        _run("compare", str(piece), str(SCAN))


def _run(*arguments: str) -> None:
    if code := run(arguments):
        raise SystemExit(code)


if __name__ == "__main__":
    main()
