"""Training data: random shapes, their meshes, the noise put on them, and data sets of noisy/clean pairs."""

from cascadenorm.data_gen.dataset import (
    OWN_FAMILY,
    DatasetConfig,
    Pair,
    clean_mesh,
    own_pair,
    pair,
    pairs,
    write_dataset,
)
from cascadenorm.data_gen.families import SHAPE_FAMILIES
from cascadenorm.data_gen.noise.noise import displacements

__all__ = [
    "OWN_FAMILY", "SHAPE_FAMILIES", "DatasetConfig", "Pair", "clean_mesh", "displacements", "own_pair", "pair", "pairs",
    "write_dataset",
]  # fmt: skip
