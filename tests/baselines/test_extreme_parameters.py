"""The last allowed values of parameters give finite meshes, and those beyond are refused."""

import numpy as np
import pytest
from shapes import icosphere, noisy

from cascadenorm.errors import ParameterError
from cascadenorm.registry import find

MESH = noisy(icosphere(2), 0.2)


@pytest.mark.parametrize(
    "name, parameter, last, beyond",
    [
        ("anisotropic-diffusion", "threshold", 1e-6, 1e-7),
        ("prescribed-mean-curvature", "threshold", 1e-6, 1e-7),
        ("rolling-guidance-normal", "sigma", 1e-6, 1e-7),
        ("l0", "regularity", 1e6, 1e7),
        ("tv-normal", "fidelity", 1e6, 1e7),
        ("tgv-normal", "fidelity", 1e6, 1e7),
        ("l0", "growth", 1e300, np.inf),
        ("spectral", "gain", 1e300, np.inf),
    ],
)
def test_the_last_allowed_value_gives_a_finite_mesh_and_those_beyond_are_refused(name, parameter, last, beyond):
    assert np.isfinite(find(name)(MESH, **{parameter: last})).all()
    with pytest.raises(ParameterError, match=f"{parameter} is"):
        find(name)(MESH, **{parameter: beyond})
