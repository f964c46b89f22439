"""Make pairs by adding noise to clean meshes."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cascadenorm.data_gen.noise.noise import displacements
from cascadenorm.io.interop import as_mesh, save_mesh
from cascadenorm.io.pairs import FilePair


def with_noise(
    pairs: Sequence[FilePair], folder: Path, *, level: float, seeds: int
) -> tuple[list[FilePair], list[tuple[FilePair, Exception]]]:
    """Write noisy versions of each clean mesh to a folder, with Gaussian noise along the normals.

    The level is the standard deviation of the noise, in mean edge lengths of the clean mesh. There are noisy meshes for
    the seeds 0, 1, …; the same seed always gives the same file. Returns the new pairs, and the pairs with an unreadable
    clean mesh, each with its error.
    """
    made: list[FilePair] = []
    unread: list[tuple[FilePair, Exception]] = []
    for pair in pairs:
        try:
            clean = as_mesh(pair.clean)
        except Exception as error:  # a damaged file, or a missing package for its format
            unread.append((pair, error))
            continue
        place = folder / re.sub(r"[/\\]", "_", pair.name)
        place.mkdir(parents=True, exist_ok=True)
        for seed in range(seeds):
            name = f"{pair.name}-seed{seed}"
            noise = displacements(clean, "normal", level=level, rng=np.random.default_rng(seed))
            file = place / f"noisy-{level:g}-{seed}.ply"
            save_mesh(file, clean.moved(clean.vertices + noise), force=True)
            made.append(FilePair(name, file, pair.clean, seed))
    return made, unread
