"""Pairs of which the noisy meshes are made from the clean ones."""

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
    """Write meshes with Gaussian noise along the normals of each clean mesh.

    Parameters
    ----------
    folder
        For the noisy meshes; it is made.
    level
        Standard deviation of the noise, in mean edge lengths of the clean mesh.
    seeds
        Noisy meshes of each clean one, from the seeds 0, 1, …; the same seeds give the same files.

    Returns
    -------
    The new pairs, and those whose clean mesh cannot be read, each with the reason
    """
    made: list[FilePair] = []
    unread: list[tuple[FilePair, Exception]] = []
    for pair in pairs:
        try:
            clean = as_mesh(pair.clean)
        except Exception as error:  # a damaged file, or a package that is missing for its format
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
