"""Fields as scanners measure them."""

import numpy as np

from cascadenorm.data_gen.meshing.surface import extent_of


def measured(kind, field, *, seed, **settings):
    rng = np.random.default_rng(seed)
    return kind(field, extent_of(field, rng=rng), faces=6000, rng=rng, **settings)
