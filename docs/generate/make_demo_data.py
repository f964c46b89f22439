"""Make the meshes of `cascadenorm demo` anew: python docs/generate/make_demo_data.py [FOLDER]."""

import sys
from pathlib import Path

import numpy as np

from cascadenorm import io
from cascadenorm.data_gen import DatasetConfig, pair

CHOSEN = {  # example: family, index in it, noise, level in mean edge lengths
    "part": ("bracket", 4, "normal", 0.25),
    "head": ("bust", 3, "gaussian", 0.15),
    "scan": ("fused", 2, "sensor", 0.3),
}


def main(folder: Path) -> None:
    """Write `<example>/noisy.ply` and `clean.ply`, in single precision."""
    for name, (family, index, noise, level) in CHOSEN.items():
        config = DatasetConfig(
            families=(family,), min_faces=7000, max_faces=9500, noise_kinds=(noise,), min_level=level, max_level=level
        )
        made = pair(config, index)
        (folder / name).mkdir(parents=True, exist_ok=True)
        for kind, mesh in (("noisy", made.noisy), ("clean", made.clean)):
            path = folder / name / f"{kind}.ply"
            io.write(io.from_arrays(mesh.vertices.astype(np.float32), mesh.faces), path, force=True)
            print(f"{path}: {len(mesh.faces)} faces, {path.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parents[2] / "cascadenorm" / "demo_data"))
