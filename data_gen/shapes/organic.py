"""Organic shapes: bodies blended from limbs, with detailed surfaces.

The detail consists of folds, hair, scales, bumps and pores.
"""

import numpy as np

from cascadenorm.data_gen.shapes.fields import (
    DistanceField,
    box,
    cylinder,
    difference,
    ellipsoid,
    half_space,
    intersection,
    limb,
    melted,
    pushed_out,
    sphere,
    superquadric,
    torus,
    tube,
    union,
)
from cascadenorm.data_gen.shapes.patterns import Form, cells, crate, labyrinth, masked, noise, stripes
from cascadenorm.data_gen.shapes.placement import (
    aligned,
    mirrored,
    moved,
    random_direction,
    random_rotation,
    tapered,
    twisted,
    warped,
)


def skin(body: DistanceField, *, finest: float, layers: int, rng: np.random.Generator) -> DistanceField:
    """Add detail of several kinds and scales to a body; `finest` is the shortest wavelength."""
    for _ in range(layers):
        wavelength = float(np.exp(rng.uniform(np.log(finest), np.log(8 * finest))))
        pattern, steepest = _pattern(rng, wavelength)
        if rng.random() < 0.5:
            pattern = masked(pattern, noise(wavelength=rng.uniform(0.5, 1.2), rng=rng))
        steepness = float(np.exp(rng.uniform(np.log(0.1 * steepest), np.log(steepest))))
        body = pushed_out(body, pattern, amplitude=steepness * wavelength)
    return body


def _pattern(rng: np.random.Generator, wavelength: float) -> tuple[DistanceField, float]:
    """Draw a pattern and the largest amplitude, in wavelengths, that still looks carved or grown."""
    kind = rng.integers(9)
    if kind <= 2:
        form: Form = rng.choice(["smooth", "ridged", "billowed"])
        octaves, gain = int(rng.integers(1, 4)), rng.uniform(0.3, 0.6)
        return noise(wavelength=1.5 * wavelength, octaves=octaves, gain=gain, form=form, rng=rng), 0.15
    if kind == 3:
        return cells(wavelength=1.5 * wavelength, kind="bumps", rng=rng), 0.3
    if kind == 4:
        return cells(wavelength=1.5 * wavelength, kind="cracks", rng=rng), 0.08
    if kind <= 6:
        wander, sharpness = rng.uniform(0.2, 1.5), float(rng.uniform(0.7, 2))
        return stripes(wavelength=wavelength, wander=wander, sharpness=sharpness, rng=rng), 0.12
    if kind == 7:
        return crate(wavelength=2 * wavelength, rng=rng), 0.35
    spots, steepness = rng.uniform(-0.7, 0.7), rng.uniform(0.7, 4)
    return labyrinth(wavelength=2 * wavelength, spots=spots, steepness=steepness, rng=rng), 0.15


def creature(edge: float, rng: np.random.Generator) -> DistanceField:
    """Return a trunk with limbs, a head and some lumps, blended; half of them mirror-symmetric; smooth surface."""
    trunk = ellipsoid(rng.uniform([0.3, 0.35, 0.3], [0.5, 0.65, 0.55]))
    parts = [trunk]
    for _ in range(rng.integers(2, 8)):
        start = 0.35 * random_direction(rng=rng)
        middle = start + rng.uniform(0.2, 0.5) * random_direction(rng=rng) + 0.3 * start
        end = middle + rng.uniform(0.2, 0.45) * random_direction(rng=rng)
        thick = np.sort(rng.uniform(0.05, 0.22, 3))[::-1]
        parts += [limb(start, middle, radii=(thick[0], thick[1])), limb(middle, end, radii=(thick[1], thick[2]))]
        if rng.random() < 0.4:
            parts.append(moved(sphere(radius=float(1.4 * thick[1])), by=end))
    body = melted(*parts, radius=rng.uniform(0.08, 0.4))
    if rng.random() < 0.5:
        body = mirrored(body)
    return _gently_warped(body, rng)


def statue(edge: float, rng: np.random.Generator) -> DistanceField:
    """Return a creature or a lump covered with folds, hair, scales and pores."""
    body = creature(edge, rng) if rng.random() < 0.6 else _lump(rng)
    return skin(body, finest=4 * edge, layers=int(rng.integers(2, 6)), rng=rng)


def mounted(edge: float, rng: np.random.Generator) -> DistanceField:
    """Return a statue on a base with sharp edges, or with a planar cut."""
    body = statue(edge, rng)
    height = rng.uniform(0.1, 0.25)
    if rng.random() < 0.3:
        return difference(body, moved(box([2, 1, 2]), by=[0, -1.4 + height, 0]))
    base = box([*rng.uniform(0.4, 0.8, 1), height, *rng.uniform(0.4, 0.8, 1)])
    if rng.random() < 0.5:
        base = aligned(cylinder(radius=rng.uniform(0.4, 0.8), half_height=height), [0, 1, 0])
    return union(body, moved(base, by=[0, -0.65, 0]))


def _lump(rng: np.random.Generator) -> DistanceField:
    parts = [
        moved(ellipsoid(rng.uniform(0.25, 0.6, 3)), by=rng.uniform(-0.4, 0.4, 3), rotation=random_rotation(rng=rng))
        for _ in range(rng.integers(2, 6))
    ]
    return melted(*parts, radius=rng.uniform(0.1, 0.4))


def bust(edge: float, rng: np.random.Generator) -> DistanceField:
    """Return a head with skull, jaw, nose, brows, eyes, lips, ears, neck, hair and fine skin."""
    wide, tall, deep = rng.uniform([0.42, 0.55, 0.5], [0.55, 0.7, 0.6])
    skull = ellipsoid([wide, tall, deep])
    jaw = moved(ellipsoid([0.75 * wide, 0.5 * tall, 0.7 * deep]), by=[0, -0.55 * tall, 0.15 * deep])
    bridge, tip = [0, 0.05, 0.95 * deep], [0, -rng.uniform(0.12, 0.25), deep + rng.uniform(0.05, 0.18)]
    nose = limb(bridge, tip, radii=(0.04, rng.uniform(0.06, 0.1)))
    apart, level = rng.uniform(0.15, 0.22), rng.uniform(0.0, 0.08)
    brow = limb([0, level + 0.11, 0.93 * deep], [apart + 0.09, level + 0.1, 0.75 * deep], radii=(0.04, 0.06))
    cheek = moved(sphere(radius=rng.uniform(0.1, 0.18)), by=[apart + 0.03, -0.15, 0.7 * deep])
    neck = limb([0, -0.5, -0.05], [0, -1.15, -0.1], radii=(rng.uniform(0.22, 0.32), 0.35))
    head = melted(skull, jaw, nose, brow, cheek, neck, radius=rng.uniform(0.05, 0.15))
    socket = moved(sphere(radius=rng.uniform(0.07, 0.12)), by=[apart, level, 0.92 * deep])
    eye = moved(sphere(radius=rng.uniform(0.07, 0.09)), by=[apart, level - 0.01, 0.82 * deep])
    face = difference(head, socket, blend="melted", radius=0.06)
    lips = [limb([-0.001, y, 0.86 * deep], [0.12, y, 0.8 * deep], radii=(0.035, 0.02)) for y in (-0.36, -0.42)]
    ear = moved(torus(major=0.09, minor=0.03), by=[wide, 0, 0], rotation=random_rotation(rng=rng))
    whole = mirrored(melted(union(face, eye), *lips, ear, radius=0.03))
    hair = stripes(wavelength=edge * rng.uniform(4, 9), wander=float(rng.uniform(0.5, 2)), sharpness=1.0, rng=rng)
    line = rng.uniform(0.1, 0.4)
    curls = masked(hair, lambda points: points[:, 1] - line - 0.6 * (points[:, 2] - 0.3), width=0.15)
    whole = pushed_out(whole, curls, amplitude=rng.uniform(0.005, 0.02))
    pores = noise(wavelength=edge * rng.uniform(6, 20), octaves=3, rng=rng)
    whole = pushed_out(whole, pores, amplitude=rng.uniform(0.0, 0.006))
    return _gently_warped(moved(lambda points: 0.9 * whole(points / 0.9), by=[0, 0.2, 0]), rng)


def bumpy(edge: float, rng: np.random.Generator) -> DistanceField:
    """Return a plain closed surface with one strong relief, regular or random."""
    kind = rng.integers(4)
    if kind == 0:
        body = torus(major=0.75, minor=rng.uniform(0.2, 0.42))
    elif kind == 1:
        body = sphere(radius=0.85)
    elif kind == 2:
        body = superquadric(rng.uniform(0.6, 0.95, 3), exponent=rng.uniform(1.2, 6))
    else:
        body = _knot(rng)
    wavelength = float(np.exp(rng.uniform(np.log(5 * edge), np.log(0.6))))
    pattern, steepest = _pattern(rng, wavelength)
    return pushed_out(body, pattern, amplitude=wavelength * steepest * rng.uniform(0.3, 1.3))


def _knot(rng: np.random.Generator) -> DistanceField:
    p, q = [(2, 3), (3, 2), (2, 5), (1, 3), (1, 5), (3, 4)][rng.integers(6)]
    t = np.linspace(0, 2 * np.pi, 110, endpoint=False)
    reach = 0.65 + 0.3 * np.cos(q * t)
    path = np.stack([reach * np.cos(p * t), reach * np.sin(p * t), 0.4 * np.sin(q * t)], axis=1)
    thick = rng.uniform(0.09, 0.17)
    return tube(path, radius=thick * (1 + 0.3 * np.sin(int(rng.integers(0, 6)) * t)), closed=True)


def smooth(edge: float, rng: np.random.Generator) -> DistanceField:
    """Return a soft shape without detail: a knot, blended rings, or a twisted and tapered superquadric."""
    kind = rng.integers(4)
    if kind == 0:
        body = _knot(rng)
    elif kind == 1:
        count = int(rng.integers(2, 5))
        rings = [_ring(2 * np.pi * k / count, rng) for k in range(count)]
        body = melted(*rings, radius=rng.uniform(0.05, 0.25))
    elif kind == 2:
        body = superquadric(rng.uniform(0.4, 0.9, 3), exponent=rng.uniform(1.1, 8))
        body = twisted(tapered(body, rate=rng.uniform(-0.7, 0.7)), rate=float(rng.uniform(-2, 2)))
    else:
        body = creature(edge, rng)
    return _gently_warped(body, rng)


def _ring(angle: float, rng: np.random.Generator) -> DistanceField:
    ring = torus(major=rng.uniform(0.35, 0.5), minor=rng.uniform(0.08, 0.16))
    turn = random_rotation(rng=rng) if rng.random() < 0.3 else None
    return moved(ring, by=[0.45 * np.cos(angle), 0.45 * np.sin(angle), 0], rotation=turn)


def rock(edge: float, rng: np.random.Generator) -> DistanceField:
    """Return fractured stone: a lump cut by a few planes, with noise of many octaves."""
    body = _lump(rng)
    cuts = [half_space(random_direction(rng=rng), at=rng.uniform(0.3, 0.7)) for _ in range(rng.integers(0, 7))]
    form: Form = rng.choice(["smooth", "ridged", "billowed"])
    grain = noise(wavelength=rng.uniform(0.3, 0.9), octaves=3, gain=rng.uniform(0.35, 0.55), form=form, rng=rng)
    return pushed_out(intersection(body, *cuts), grain, amplitude=rng.uniform(0.01, 0.06))


def _gently_warped(body: DistanceField, rng: np.random.Generator) -> DistanceField:
    wavelength = rng.uniform(0.8, 1.6)
    warps = [noise(wavelength=wavelength, rng=rng) for _ in range(3)]
    return warped(body, warps, amplitude=rng.uniform(0, 0.12) * wavelength)
