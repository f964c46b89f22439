"""Draw several meshes in one figure with a common camera and colour scale."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cascadenorm.errors import ParameterError
from cascadenorm.geometry.fields import QUANTITIES, Field, field
from cascadenorm.io.interop import as_mesh
from cascadenorm.mesh import Mesh, scale_between, scaled_alike
from cascadenorm.render import Bar, Camera, HeatMap, Image, Inset, Panel, montage, render
from cascadenorm.render.camera import Up
from cascadenorm.render.figure import GAP

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FRAMES = 72  # number of frames of a turntable


@dataclass(frozen=True, kw_only=True)
class Style:
    """Settings of a picture of meshes; `smooth`, `wireframe` and `transparent` are those of `render`."""

    size: int = 600  # width and height of each picture in pixels
    direction: ArrayLike | None = None  # from the meshes toward the viewer, as in `Camera.looking_at`
    up: Up = "y"  # mesh axis that points up in the picture
    target: ArrayLike | None = None  # (3,) point in the middle of the picture; None uses the center of the mesh
    distance: float | None = None  # of the viewer from the target, in the unit of the files; None shows the whole mesh
    values: str | None = None  # one of QUANTITIES, to be shown as colours
    reference: Any = None  # mesh that the values refer to; None uses the first mesh and draws it without colours
    limits: tuple[float, float] | None = None  # values at the ends of the colour scale; None derives them
    crops: Sequence[tuple[float, float, float]] = ()  # parts to enlarge below each picture
    smooth: bool = False
    wireframe: bool = False
    transparent: bool = False


def check_style(style: Style, count: int) -> None:
    """Reject invalid settings before any work is done."""
    if style.values is not None:
        if style.values not in QUANTITIES:
            problem = f"is {style.values!r}; it must be one of {', '.join(QUANTITIES)}"
            raise ParameterError(problem, parameter="values")
        if QUANTITIES[style.values].against and style.reference is None and count < 2:
            hint = "give a reference, or a second mesh"
            raise ParameterError(f"{style.values} compares a mesh with another one", hint=hint)
    if style.distance is not None and not 0 < style.distance < np.inf:
        raise ParameterError(f"is {style.distance}; it must be positive and finite", parameter="distance")
    if style.limits is not None and not style.limits[0] < style.limits[1]:
        raise ParameterError(f"is {style.limits}; the first must be below the second", parameter="limits")
    for crop in style.crops:
        x, y, width = crop
        inside = all(width / 2 <= middle <= 1 - width / 2 for middle in (x, y))
        if not (0 < width <= 1 and inside):
            problem = f"is {', '.join(map(str, crop))}; it must lie in the picture, from 0 to 1 in both directions"
            raise ParameterError(problem, parameter="crop")


class Scene(NamedTuple):
    """Meshes with a common scale, their captions, and the values shown on them."""

    shown: list[Mesh]
    captions: list[str]
    maps: list[HeatMap | None]
    quantities: Field | None
    limits: tuple[float, float]
    unit: float
    style: Style


def scene(meshes: list[Mesh], names: Sequence[str], style: Style) -> Scene:
    others = [] if style.reference is None else [as_mesh(style.reference)]
    scaled = scaled_alike(*meshes, *others)
    unit = scale_between(meshes[0], scaled[0])
    shown, captions = scaled[: len(meshes)], list(names)
    if style.values is None:
        return Scene(shown, captions, [None] * len(shown), None, (0.0, 1.0), unit, style)
    other = scaled[-1] if others else shown[0]
    plain = QUANTITIES[style.values].against is not None and not others
    keys = [f"mesh {number}" for number in range(1, len(shown) + 1)]
    seen = dict(zip(keys[plain:], shown[plain:], strict=True))
    found = field(style.values, seen, other, unit)
    limits = style.limits or found.limits
    quantity = found.quantity
    maps = [
        HeatMap(found.values[key], quantity.at, limits, quantity.signed) if key in found.values else None
        for key in keys
    ]
    if not quantity.signed:
        degrees = "°" if quantity.unit == "°" else ""
        for number, heat in enumerate(maps):
            if heat is not None and np.isfinite(heat.values).any():
                captions[number] = f"{captions[number]}  mean {np.nanmean(heat.values):#.3g}{degrees}".strip()
    return Scene(shown, captions, maps, found, limits, unit, style)


def one_view(scene: Scene) -> list[Camera]:
    """Return the camera for each mesh."""
    style, camera = scene.style, _looking_at(scene.shown[-1], scene.style)
    if style.target is None and style.distance is None:
        return [camera if camera.shows(mesh) else _looking_at(mesh, style) for mesh in scene.shown]
    target = camera.center if style.target is None else np.asarray(style.target, float) / scene.unit
    if style.distance is None:
        camera = replace(camera, center=target)
    else:
        camera = Camera.at_distance(camera.axes[2], target, style.distance / scene.unit, up=style.up)
    return [camera] * len(scene.shown)


def turntable_views(scene: Scene) -> Iterator[tuple[Camera, ...]]:
    """Yield the cameras of all meshes for each frame of a turntable."""
    style, last = scene.style, scene.shown[-1]
    if style.target is not None or style.distance is not None:
        turned = [camera.turned(count=FRAMES, up=style.up) for camera in one_view(scene)]
    else:
        camera = _looking_at(last, style)
        starts = [(camera, last) if camera.shows(mesh) else (_looking_at(mesh, style), mesh) for mesh in scene.shown]
        turned = [start.around(mesh, count=FRAMES, up=style.up) for start, mesh in starts]
    return zip(*turned, strict=True)


def _looking_at(mesh: Mesh, style: Style) -> Camera:
    return Camera.looking_at(mesh, direction=style.direction, up=style.up)


def figure(scene: Scene, cameras: Sequence[Camera]) -> "Figure":
    """Draw the panels and the colour bar beside them."""
    return montage([panels(scene, cameras)], bar=color_bar(scene))


def panels(scene: Scene, cameras: Sequence[Camera]) -> list[Panel]:
    """Draw each mesh as seen by its camera."""
    return [_panel(scene, number, camera) for number, camera in enumerate(cameras)]


def color_bar(scene: Scene) -> Bar | None:
    """Return the colour bar of the values; its label names the mesh that they refer to."""
    if scene.quantities is None:
        return None
    quantity = scene.quantities.quantity
    label = f"{quantity.label} ({quantity.unit})" if quantity.unit else quantity.label
    if scene.style.reference is not None:
        label = label.replace("the input", "the reference").replace("the truth", "the reference")
    label = label.replace("the truth", "the first mesh")
    return Bar(label, scene.limits, quantity.signed)


def _panel(scene: Scene, number: int, camera: Camera) -> Panel:
    style = scene.style
    size = (style.size, style.size)

    def picture(view: Camera, side: int) -> Image:
        return render(
            scene.shown[number],
            view=view,
            size=(side, side),
            values=scene.maps[number],
            smooth=style.smooth,
            wireframe=style.wireframe,
            transparent=style.transparent,
        )

    count = len(style.crops)
    ends = [round(number * (style.size + GAP) / max(count, 1)) for number in range(count + 1)]
    sides = [stop - start - GAP for start, stop in pairwise(ends)]
    insets = [
        Inset(*crop, picture(camera.cropped(*crop, size=size), side))
        for crop, side in zip(style.crops, sides, strict=True)
    ]
    return Panel(picture(camera, style.size), scene.captions[number], insets)
