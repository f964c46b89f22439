"""Training data: random shapes, their meshes, the noise put on them, and data sets of noisy/clean pairs."""

from cascadenorm.data_gen.dataset import (
    OWN_FAMILY,
    DatasetConfig,
    Pair,
    clean_mesh,
    family_of,
    own_pair,
    pair,
    pairs,
    write_dataset,
)
from cascadenorm.data_gen.families import SHAPE_FAMILIES, ShapeFamily
from cascadenorm.data_gen.noise.noise import NoiseKind, displacements

__all__ = [
    "OWN_FAMILY", "SHAPE_FAMILIES", "DatasetConfig", "NoiseKind", "Pair", "ShapeFamily", "clean_mesh", "displacements",
    "family_of", "own_pair", "pair", "pairs", "write_dataset",
]  # fmt: skip
