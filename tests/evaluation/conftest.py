"""Pairs to evaluate methods on."""

import pytest
from evaluated import SHAPES
from shapes import noisy

from cascadenorm.io.interop import save_mesh


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    root = tmp_path_factory.mktemp("pairs")
    for name, clean in SHAPES.items():
        (root / name).mkdir()
        save_mesh(root / name / "noisy.ply", noisy(clean, 0.2))
        save_mesh(root / name / "clean.ply", clean)
    (root / "notes").mkdir()
    return root
