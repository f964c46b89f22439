"""Distance fields, places in space, and lattices of values."""

import numpy as np

from cascadenorm.data_gen.meshing.lattice import sample
from cascadenorm.data_gen.shapes import fields, placement, profiles


def points(seed: int, *, count: int = 2000, reach: float = 1.5) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-reach, reach, (count, 3))


HEXAGON = np.stack([np.cos(np.arange(6) * np.pi / 3), np.sin(np.arange(6) * np.pi / 3)], axis=1)
EXACT = {
    "sphere": fields.sphere(radius=0.8),
    "box": fields.box([0.5, 0.7, 0.3]),
    "cylinder": fields.cylinder(radius=0.4, half_height=0.6),
    "torus": fields.torus(major=0.8, minor=0.25),
    "tube": fields.tube(points(3, count=7), radius=0.2),
    "polytope": fields.polytope(np.concatenate([np.eye(3), -np.eye(3)]), np.full(6, 0.7)),
    "prism": profiles.extruded(profiles.polygon(HEXAGON), half_height=0.4),
    "lathe": profiles.revolved(profiles.polygon(HEXAGON + np.array([1.5, 0]))),
    "moved": placement.moved(fields.box([0.5, 0.7, 0.3]), by=[0.1, 0.2, 0.3], rotation=np.eye(3)[[1, 2, 0]]),
    "repeated": placement.around(placement.moved(fields.sphere(radius=0.2), by=[0.8, 0, 0]), count=5),
}
TURN = placement.random_rotation(rng=np.random.default_rng(5))
HALF = np.array([0.7, 0.6, 0.5])
CUBE = placement.moved(fields.box(HALF), rotation=TURN)


def lattice_of(field, spacing, *, jitter=0.0, seed=0):
    rng = np.random.default_rng(seed)
    return sample(field, lower=[-1.3] * 3, upper=[1.3] * 3, spacing=spacing, jitter=jitter, rng=rng)
