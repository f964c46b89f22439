"""Machine parts with flat, cylindrical and conical faces, and worked edges.

The edges are sharp, filleted or chamfered.
"""

import numpy as np

from cascadenorm.data_gen.shapes.fields import (
    Blend,
    DistanceField,
    box,
    cylinder,
    difference,
    intersection,
    offset,
    polytope,
    sphere,
    torus,
    union,
)
from cascadenorm.data_gen.shapes.placement import aligned, around, bent, moved, random_rotation, tapered, twisted
from cascadenorm.data_gen.shapes.profiles import Profile, extruded, gear, lobed, polygon, revolved
from cascadenorm.mesh import Vectors, unit


def blend_of(rng: np.random.Generator, *, edge: float, largest: float = 0.15) -> tuple[Blend, float]:
    """Draw how an edge is finished: half stay sharp, most fillets and chamfers are at least two triangles wide."""
    blend: Blend = rng.choice(["sharp", "round", "chamfer"], p=[0.5, 0.32, 0.18])
    return blend, rng.uniform(min(2 * edge, 0.8 * largest), largest)


def assembly(edge: float, rng: np.random.Generator) -> DistanceField:
    """Join and cut random solids."""
    total = _solid(rng, size=rng.uniform(0.6, 0.85))
    upright = rng.random() < 0.6  # parts along the axes of the first solid, as machined ones are, or tilted
    for _ in range(rng.integers(2, 8)):
        part = _solid(rng, size=rng.uniform(0.2, 0.6))
        turn = np.eye(3)[rng.permutation(3)] if upright else random_rotation(rng=rng)
        part = moved(part, by=rng.uniform(-0.75, 0.75, 3), rotation=turn)
        blend, radius = blend_of(rng, edge=edge)
        combined = union if rng.random() < 0.5 else difference
        total = combined(total, part, blend=blend, radius=radius)
    if rng.random() < 0.25:
        total = intersection(total, sphere(radius=rng.uniform(0.8, 1.0)))
    return total


def _solid(rng: np.random.Generator, *, size: float) -> DistanceField:
    a, b, c = size * rng.uniform(0.5, 1.1, 3)
    kind = rng.integers(8)
    if kind <= 1:
        return box([a, b, c])
    if kind == 2:
        return cylinder(radius=0.8 * a, half_height=b)
    if kind == 3:
        return sphere(radius=a)
    if kind == 4:
        return revolved(polygon([[-1.0, -b], [0.9 * a, -b], [rng.uniform(0, 0.8) * a, b], [-1.0, b]]))
    if kind == 5:
        return extruded(polygon(_convex_corners(rng, radius=a)), half_height=b)
    if kind == 6:
        return torus(major=0.7 * a, minor=0.3 * b)
    return offset(box(np.array([a, b, c]) - 0.15 * size), by=0.15 * size)


def _convex_corners(rng: np.random.Generator, *, radius: float) -> Vectors:
    count = int(rng.integers(3, 9))
    angle = 2 * np.pi * (np.arange(count) + rng.uniform(-0.25, 0.25, count)) / count
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def bracket(edge: float, rng: np.random.Generator) -> DistanceField:
    """Return plates at right angles with ribs, bosses and rows of holes; the walls are thin or thick."""
    wall = max(1.5 * edge, rng.uniform(0.06, 0.18))
    width, depth, height = rng.uniform(0.5, 0.95, 3)
    blend, radius = blend_of(rng, edge=edge)
    base = moved(box([width, depth, wall]), by=[0, 0, -height])
    total = union(base, moved(box([wall, depth, height]), by=[-width + wall, 0, 0]), blend=blend, radius=radius)
    if rng.random() < 0.5:
        back = moved(box([width, wall, height]), by=[0, -depth + wall, 0])
        total = union(total, back, blend=blend, radius=radius)
    for _ in range(rng.integers(0, 3)):
        triangle = polygon([[-width, -height], [width, -height], [-width, height]])
        rib = extruded(triangle, half_height=max(1.3 * edge, 0.5 * wall))
        rib = moved(rib, rotation=np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), by=[0, rng.uniform(-depth, depth), 0])
        total = union(total, rib, blend=blend, radius=0.5 * radius)
    for _ in range(rng.integers(0, 3)):
        bore = rng.uniform(max(0.08, 2 * edge), 0.25)
        at = [rng.uniform(-0.5, 0.6) * width, rng.uniform(-0.6, 0.6) * depth, -height]
        top = rng.uniform(0.1, 0.5)
        boss = moved(cylinder(radius=1.6 * bore, half_height=top), by=at)
        boss = intersection(boss, moved(box([2, 2, 1]), by=[0, 0, 1 - height]))
        total = union(total, boss, blend=blend, radius=radius)
        total = difference(total, moved(cylinder(radius=bore, half_height=2), by=at))
    for axis in ([0, 0, 1], [1, 0, 0]):
        for _ in range(rng.integers(0, 4)):
            at = rng.uniform(-0.75, 0.75, 3) * [width, depth, height]
            at[int(np.argmax(axis))] = -(height if axis[2] else width)
            hole = cylinder(radius=rng.uniform(1.5 * edge, 0.22), half_height=0.4)
            if rng.random() < 0.3:
                hole = box([*rng.uniform(0.06, 0.25, 2), 0.4])
            total = difference(total, aligned(hole, axis, by=at))
    return total


def wheel(edge: float, rng: np.random.Generator) -> DistanceField:
    """Return a gear, pulley, flange or knob: a toothed or lobed disc with hub, bore, keyway, spokes or holes."""
    radius, thick = rng.uniform(0.75, 1.1), rng.uniform(0.1, 0.4)
    teeth = int(rng.integers(5, 1 + min(28, int(2 * np.pi * radius / (8 * edge)))))
    rim: Profile = sphere(radius=radius)
    if rng.random() < 0.75:
        depth, slope = rng.uniform(1, 2.5) / teeth, float(rng.choice([0, 1.5, 3, 8]))
        rim = gear(teeth=teeth, radius=radius, depth=depth, slope=slope)
    blend, fillet = blend_of(rng, edge=edge, largest=0.1)
    total = extruded(rim, half_height=thick, blend=blend, radius=fillet)
    if rng.random() < 0.3:
        total = twisted(total, rate=rng.uniform(-1, 1))
    hub = rng.uniform(0.2, 0.4) * radius
    if rng.random() < 0.6:
        recess = difference(cylinder(radius=0.75 * radius, half_height=1), cylinder(radius=hub, half_height=2))
        for side in (-1, 1):
            depth = rng.uniform(0.3, 0.85) * thick
            cut = moved(recess, by=[0, 0, side * (2 * thick - depth + (1 - thick))])
            total = difference(total, cut, blend=blend, radius=fillet)
    if rng.random() < 0.5:
        tall = cylinder(radius=hub, half_height=thick + rng.uniform(0.05, 0.4))
        total = union(total, tall, blend=blend, radius=fillet)
    if rng.random() < 0.7:
        hole = cylinder(radius=rng.uniform(0.06, 0.13), half_height=2)
        if rng.random() < 0.3:
            hole = extruded(polygon(_convex_corners(rng, radius=0.16)), half_height=2)
        total = difference(total, around(moved(hole, by=[0.56 * radius, 0, 0]), count=int(rng.integers(3, 9))))
    bore = rng.uniform(0.4, 0.8) * hub
    total = difference(total, cylinder(radius=bore, half_height=3))
    if rng.random() < 0.5:
        total = difference(total, moved(box([0.3 * bore, 0.3 * bore, 3]), by=[bore, 0, 0]))
    return total


def turned(edge: float, rng: np.random.Generator) -> DistanceField:
    """Return a turned part: a stepped, tapered, grooved profile about an axis, with flats, flutes or cross holes."""
    count = int(rng.integers(3, 8))
    heights = np.linspace(-1, 1, count) + rng.uniform(-0.6, 0.6, count) / count
    heights[[0, -1]] = -1.05, 1.05
    radii = rng.uniform(0.2, 0.8, len(heights))
    corners = [[-0.5, -1.05]]
    for k in range(len(heights)):
        if k and rng.random() < 0.6:
            corners.append([radii[k - 1], heights[k]])
        corners.append([radii[k], heights[k]])
    corners.append([-0.5, 1.05])
    total = revolved(polygon(corners))
    if rng.random() < 0.4:
        round_ = rng.uniform(2 * edge, 4 * edge)
        total = offset(revolved(polygon(np.array(corners) - [[round_, 0]])), by=round_)
    if rng.random() < 0.6:
        cut: DistanceField = cylinder(radius=rng.uniform(0.04, 0.12), half_height=2)
        cut = moved(cut, by=[rng.uniform(0.3, 0.7), 0, 0])
        total = difference(total, around(cut, count=int(rng.integers(2, 14))))
    if rng.random() < 0.4:
        at = [0, 0, rng.uniform(-0.7, 0.7)]
        total = difference(total, aligned(cylinder(radius=rng.uniform(0.08, 0.2), half_height=2), [1, 0, 0], by=at))
    if rng.random() < 0.3:
        total = intersection(total, box([rng.uniform(0.3, 0.6), 2, 2]))
    if rng.random() < 0.5:
        total = difference(total, cylinder(radius=rng.uniform(0.08, 0.15), half_height=2))
    return total


def plate(edge: float, rng: np.random.Generator) -> DistanceField:
    """Return an extruded random outline with pockets, holes and worked edges; sometimes bent or tapered."""
    kind = rng.integers(4)
    if kind == 0:
        count = int(rng.integers(5, 14))
        angle = 2 * np.pi * (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count
        reach = rng.uniform(0.4, 1.1, count)
        outline = polygon(np.stack([reach * np.cos(angle), reach * np.sin(angle)], axis=1))
    elif kind == 1:
        orders = int(rng.integers(2, 7))
        waves = rng.normal(size=2 * orders) * 0.18 / np.repeat(np.arange(1, orders + 1), 2)
        outline = lobed(radii=np.concatenate([[0.75], waves]))
    elif kind == 2:
        outline = _steps(rng)
    else:
        outline = box(rng.uniform(0.5, 1, 2))
    thick = float(np.exp(rng.uniform(np.log(0.07), np.log(0.6))))
    blend, radius = blend_of(rng, edge=edge, largest=min(0.2, 0.9 * thick))
    total = extruded(outline, half_height=thick, blend=blend, radius=radius)
    for _ in range(rng.integers(0, 5)):
        at = np.append(rng.uniform(-0.6, 0.6, 2), 0)
        depth = float(rng.choice([2.0, 0.5 * thick]))
        hole: DistanceField = cylinder(radius=rng.uniform(0.06, 0.25), half_height=depth)
        if rng.random() < 0.4:
            hole = box([*rng.uniform(0.08, 0.35, 2), depth])
        total = difference(total, moved(hole, by=at + np.array([0, 0, thick if depth < 1 else 0])))
    if rng.random() < 0.25:
        upright = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # so that it bends across its thickness
        total = bent(moved(total, rotation=upright), curvature=rng.uniform(-0.7, 0.7))
    elif rng.random() < 0.25:
        total = tapered(total, rate=rng.uniform(-0.6, 0.6))
    return total


def _steps(rng: np.random.Generator) -> Profile:
    """Return the outline of a stepped profile, as of rails and extrusions."""
    count = int(rng.integers(2, 6))
    x = np.linspace(-0.9, 0.9, count + 1)
    y = rng.uniform(0, 0.9, count)
    top = np.stack([np.repeat(x, 2)[1:-1], np.repeat(y, 2)], axis=1)
    return polygon(np.concatenate([top, [[0.9, -0.6], [-0.9, -0.6]]]))


def fan(edge: float, rng: np.random.Generator) -> DistanceField:
    """Return curved sheet-like parts: blades on a hub, scoops, wedges cut by cylinders."""
    blades = int(rng.integers(2, 6))
    blade = bent(
        box([0.55, max(1.3 * edge, rng.uniform(0.04, 0.13)), rng.uniform(0.25, 0.5)]), curvature=rng.uniform(-1, 1)
    )
    blade = moved(blade, by=[0.6, 0, 0], rotation=_tilt(rng.uniform(-0.8, 0.8)))
    blend, radius = blend_of(rng, edge=edge)
    hub = revolved(polygon([[-1, -0.4], [rng.uniform(0.28, 0.45), -0.4], [rng.uniform(0.25, 0.4), 0.4], [-1, 0.4]]))
    total = union(hub, around(blade, count=blades), blend=blend, radius=radius)
    if rng.random() < 0.5:
        total = intersection(total, cylinder(radius=rng.uniform(0.8, 1.1), half_height=rng.uniform(0.25, 0.6)))
    if rng.random() < 0.4:
        ring = difference(cylinder(radius=1.15, half_height=0.2), cylinder(radius=1.05, half_height=1))
        total = union(total, ring, blend=blend, radius=radius)
    if rng.random() < 0.6:
        total = difference(total, cylinder(radius=0.12, half_height=2))
    return total


def _tilt(angle: float) -> Vectors:
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0, 0], [0, cos, -sin], [0, sin, cos]])


def tabletop(edge: float, rng: np.random.Generator) -> DistanceField:
    """Return a few plain solids, among them cones and pyramids, some of them standing on a slab."""
    parts = []
    count = int(rng.integers(1, 4))
    for k in range(count):
        size = rng.uniform(0.35, 0.75) / count**0.4
        high = size * rng.uniform(0.7, 1.6)
        kind = rng.integers(5)
        top = float(rng.choice([0.0, rng.uniform(0.1, 0.8)])) * size
        if kind <= 1:
            solid = revolved(polygon([[-size, -high], [size, -high], [top, high], [-size, high]]))
        elif kind == 2:
            flanks = unit(np.array([[1.0, 0, 0.4], [-1, 0, 0.4], [0, 1, 0.4], [0, -1, 0.4], [0, 0, -1]]))
            solid = polytope(flanks, np.array([0.4, 0.4, 0.4, 0.4, 0.6]) * size)
        elif kind == 3:
            solid = sphere(radius=size)
        else:
            solid = _solid(rng, size=size)
        angle = 2 * np.pi * (k + rng.uniform(-0.2, 0.2)) / count
        away = 0.0 if count == 1 else 0.6
        turn = random_rotation(rng=rng) if rng.random() < 0.3 else None
        parts.append(moved(solid, by=[away * np.cos(angle), away * np.sin(angle), 0], rotation=turn))
    scene = union(*parts)
    if rng.random() < 0.5:
        scene = union(scene, moved(box([1.1, 1.1, 2 * edge]), by=[0, 0, -rng.uniform(0.4, 0.6)]))
    return scene
