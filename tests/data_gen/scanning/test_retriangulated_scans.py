"""Decimated and remeshed scans keep the error of the scan."""

import numpy as np
import pytest
from small_datasets import SMALL

from cascadenorm.data_gen import DatasetConfig, pair
from cascadenorm.data_gen.scanning import retriangulated_scans
from cascadenorm.mesh import angles_between


@pytest.mark.parametrize("remeshed", [0.0, 1.0])
def test_scans_with_other_triangles_keep_their_error(remeshed, monkeypatch):
    monkeypatch.setattr(retriangulated_scans, "REMESHED", remeshed)

    def mean_angle(level):
        config = DatasetConfig(seed=5, families=("retriangulated_scan",), min_level=level, max_level=level, **SMALL)
        made = [pair(config, index) for index in (3, 8)]  # others are masks, which have no level
        assert {one.noise_kind for one in made} == {"none"}
        return np.mean([np.degrees(angles_between(one.noisy.face_normals, one.normals)).mean() for one in made])

    assert 2 < mean_angle(0.05) < 0.8 * mean_angle(0.7) < 30
