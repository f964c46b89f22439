"""Scalar patterns in space: noise, ridges, cells, stripes, spots and labyrinths.

The values are of about unit size.
"""

from typing import Literal

import numpy as np

from cascadenorm.data_gen.shapes.fields import DistanceField, Values, computed
from cascadenorm.data_gen.shapes.placement import log_uniform, random_rotation
from cascadenorm.mesh import Floats, Vectors, kernel

WAVELENGTHS = 3.5, 16.0  # wavelengths of relief, in mean edge lengths
STEEPNESS = 0.01, 0.16  # ratio of the height of relief to its wavelength, log-uniform
STEEP = 0.01, 0.2  # the same of steep relief, uniform

Form = Literal["smooth", "ridged", "billowed"]
"""How octaves are combined: unchanged, with sharp crests (folds of cloth, wrinkles), or with sharp valleys (clouds,
pebbles)."""


def seed_of(rng: np.random.Generator) -> int:
    """Draw the number that distinguishes one noise field from another."""
    return int(rng.integers(1, 2**31 - 1))


def noise(
    *, wavelength: float, octaves: int = 1, gain: float = 0.5, form: Form = "smooth", rng: np.random.Generator
) -> DistanceField:
    """Return gradient noise. Each octave has half the wavelength and `gain` times the size of the previous one."""
    field = computed(_octaves, seed_of(rng), octaves, gain, ("smooth", "ridged", "billowed").index(form))
    return lambda points: field(np.ascontiguousarray(points) / wavelength)


def smooth_relief(*, edge: float, waves: bool, steep: bool = False, rng: np.random.Generator) -> DistanceField:
    """Return the heights of a relief that meshes with the given mean edge length resolve: waves, or gradient noise.

    Most reliefs are flat. With `steep`, all heights up to a fifth of the wavelength are equally likely.
    """
    wavelength = log_uniform(WAVELENGTHS, rng=rng) * edge
    height = wavelength * (rng.uniform(*STEEP) if steep else log_uniform(STEEPNESS, rng=rng))
    pattern = sines(wavelength=wavelength, rng=rng) if waves else noise(wavelength=wavelength, rng=rng)
    return lambda points: height * pattern(points)


def sines(*, wavelength: float, rng: np.random.Generator) -> DistanceField:
    """Return the product, or half the sum, of sine waves along three perpendicular axes in random directions."""
    axes, phases = random_rotation(rng=rng) * (2 * np.pi / wavelength), rng.uniform(0, 2 * np.pi, 3)
    product = rng.random() < 0.5

    def pattern(points: Vectors) -> Values:
        waves = np.sin(points @ axes + phases)
        return np.asarray(waves.prod(axis=1) if product else waves.sum(axis=1) / 2)

    return pattern


def cells(*, wavelength: float, kind: Literal["bumps", "cracks"], rng: np.random.Generator) -> DistanceField:
    """Return round bumps about scattered points (scales, warts, pebbles), or the cracks between their cells."""
    seed = seed_of(rng)

    def pattern(points: Vectors) -> Values:
        nearest = np.empty((len(points), 2))
        _nearest(np.ascontiguousarray(points) / wavelength, seed, nearest)
        if kind == "bumps":
            return np.asarray(1 - 2 * np.minimum(nearest[:, 0], 1) ** 2)
        return np.asarray(2 * np.minimum((nearest[:, 1] - nearest[:, 0]) / 0.35, 1) - 1)

    return pattern


def stripes(*, wavelength: float, wander: float, sharpness: float, rng: np.random.Generator) -> DistanceField:
    """Return wavy grooves across a random direction, like hair or grain; `sharpness` turns waves into narrow cuts."""
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    bend = noise(wavelength=rng.uniform(4, 12) * wavelength, octaves=2, rng=rng)

    def pattern(points: Vectors) -> Values:
        phase = (points @ axis + wander * wavelength * bend(points)) * (2 * np.pi / wavelength)
        return np.asarray(1 - 2 * np.abs(np.sin(0.5 * phase)) ** sharpness)

    return pattern


def labyrinth(*, wavelength: float, spots: float, steepness: float, rng: np.random.Generator) -> DistanceField:
    """Return plateaus of one width with steep sides, as in reaction-diffusion patterns.

    The pattern is a sum of waves of one length in all directions, cut at a level: `spots` = 0 gives a labyrinth, values
    towards ±1 give islands.
    """
    count = 14
    axes = rng.normal(size=(count, 3))
    axes *= (2 * np.pi / wavelength) / np.linalg.norm(axes, axis=1, keepdims=True)
    axes *= rng.uniform(0.85, 1.15, (count, 1))
    phases = rng.uniform(0, 2 * np.pi, count)

    def pattern(points: Vectors) -> Values:
        waves = np.zeros(len(points))
        for axis, phase in zip(axes, phases, strict=True):
            waves += np.cos(points @ axis + phase)
        return np.asarray(np.tanh(steepness * (waves / np.sqrt(count / 2) - spots)))

    return pattern


def crate(*, wavelength: float, rng: np.random.Generator) -> DistanceField:
    """Return regular bumps and pits, as in an egg crate: a product of perpendicular waves with random phases."""
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0] * (2 * np.pi / wavelength)
    phases = rng.uniform(0, 2 * np.pi, 3)
    flat = rng.random() < 0.5  # two waves make columns, three make cells

    def pattern(points: Vectors) -> Values:
        waves = np.cos(points @ axes + phases)
        return np.asarray(waves[:, 0] * waves[:, 1] * (1.0 if flat else waves[:, 2]))

    return pattern


def masked(pattern: DistanceField, mask: DistanceField, *, width: float = 0.2) -> DistanceField:
    """Keep a pattern where another one is positive, and fade it out over `width`."""
    return lambda points: pattern(points) * np.clip(mask(points) / width + 0.5, 0, 1)


@kernel
def _hash(x: int, y: int, z: int, seed: int) -> int:
    h = (x * 374761393 + y * 668265263 + z * 2147483647 + seed * 1274126177) & 0xFFFFFFFF
    h = ((h ^ (h >> 13)) * 1274126177) & 0xFFFFFFFF
    h = ((h ^ (h >> 16)) * 2246822519) & 0xFFFFFFFF
    return h ^ (h >> 15)


@kernel
def _slope(h: int, dx: float, dy: float, dz: float) -> float:
    """Return the product of the offset and one of 12 directions to the edges of a cube (Perlin 2002)."""
    side = h % 12
    a = dx if side < 8 else dy
    b = dy if side < 4 else dz
    return (a if h & 16 else -a) + (b if h & 32 else -b)


@kernel
def _gradient_noise(x: float, y: float, z: float, seed: int) -> float:
    i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
    u, v, w = x - i, y - j, z - k
    total = 0.0
    for corner in range(8):
        a, b, c = corner & 1, (corner >> 1) & 1, corner >> 2
        p, q, r = abs(u - (1 - a)), abs(v - (1 - b)), abs(w - (1 - c))
        weight = (p * p * p * (p * (p * 6 - 15) + 10)) * (q * q * q * (q * (q * 6 - 15) + 10))
        weight *= r * r * r * (r * (r * 6 - 15) + 10)
        total += weight * _slope(_hash(i + a, j + b, k + c, seed), u - a, v - b, w - c)
    return total


@kernel
def _octaves(points: Vectors, seed: int, octaves: int, gain: float, code: int, values: Floats) -> None:
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        total, size = 0.0, 1.0
        for octave in range(octaves):
            value = 1.6 * _gradient_noise(x, y, z, seed + octave)
            if code == 1:
                value = 1 - 3 * abs(value)
            elif code == 2:
                value = 3 * abs(value) - 1
            total += size * value
            size *= gain
            # The rotation keeps the lattices of the octaves from aligning.
            x, y, z = 2 * (0.8 * x - 0.6 * y) + 17.3, 2 * (0.6 * x + 0.8 * y) - 5.1, 2 * z + 9.7
        values[n] = total


@kernel
def _nearest(points: Vectors, seed: int, nearest: Floats) -> None:
    """Return the distances to the nearest and second nearest of scattered points, one per unit cell."""
    for n in range(len(points)):
        i, j, k = int(np.floor(points[n, 0])), int(np.floor(points[n, 1])), int(np.floor(points[n, 2]))
        first = second = 9.0
        for a in range(i - 1, i + 2):
            for b in range(j - 1, j + 2):
                for c in range(k - 1, k + 2):
                    h = _hash(a, b, c, seed)
                    dx = a + (h & 1023) / 1024.0 - points[n, 0]
                    dy = b + ((h >> 10) & 1023) / 1024.0 - points[n, 1]
                    dz = c + ((h >> 20) & 1023) / 1024.0 - points[n, 2]
                    d = dx * dx + dy * dy + dz * dz
                    if d < first:
                        first, second = d, first
                    elif d < second:
                        second = d
        nearest[n, 0], nearest[n, 1] = np.sqrt(first), np.sqrt(second)
