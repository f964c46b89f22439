"""Measure what methods do to meshes that are clean, or nearly.

    python -m benchmarks.accuracy.low_noise DIR [--method NAME ...]

The clean meshes of the pairs in DIR, each once, get a little Gaussian noise along their normals. The table replaces
what stands between the markers in docs/models.md.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import cascadenorm as cn
from benchmarks.accuracy.results import between_markers
from cascadenorm.data_gen.noise.noise import displacements
from cascadenorm.geometry.metrics import measure
from cascadenorm.io.interop import as_mesh
from cascadenorm.io.pairs import find_pairs

LEVELS = (0.0, 0.01, 0.03)  # mean edge lengths
BEGIN, END = "<!-- low noise: written by benchmarks/accuracy/low_noise.py -->", "<!-- end of low noise -->"


def main(arguments: Sequence[str] | None = None) -> None:
    """Denoise each clean mesh at each level by each method; write the means and the worst."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="DIR", help="pairs: */noisy.* and */clean.*")
    parser.add_argument("--text", type=Path, default=Path(__file__).parents[2] / "docs" / "models.md")
    parser.add_argument("--method", action="append", help="may be given several times")
    chosen = parser.parse_args(arguments)
    methods = chosen.method or ["auto", "cascade", "bilateral-normal"]
    clean = {pair.clean.read_bytes(): as_mesh(pair.clean) for pair in find_pairs([chosen.folder])}
    rows = []
    for level in LEVELS:
        angles: dict[str, list[float]] = {method: [] for method in ("noisy", *methods)}
        for mesh in clean.values():
            noise = displacements(mesh, "normal", level=level, rng=np.random.default_rng(0))
            noisy = mesh.moved(mesh.vertices + noise)
            angles["noisy"].append(measure(noisy, mesh).normal_error_deg)
            for method in methods:
                angles[method].append(measure(cn.denoise(noisy, method=method), mesh).normal_error_deg)
        rows.append(f"| {level:g} | " + " | ".join(f"{np.mean(a):.2f} ({max(a):.2f})" for a in angles.values()) + " |")
        print(rows[-1], flush=True)
    head = [f"| noise | noisy | {' | '.join(methods)} |", "| ---: |" + " ---: |" * (1 + len(methods))]
    text = chosen.text.read_text(encoding="utf-8")
    chosen.text.write_text(between_markers(text, "\n".join(head + rows), BEGIN, END), encoding="utf-8")


if __name__ == "__main__":
    main()
