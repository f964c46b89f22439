"""Parse the text options of the command `render`."""

from collections.abc import Sequence
from math import isfinite
from typing import cast

import typer

from cascadenorm.render.camera import AROUND, Up, direction_of_angles, named_direction


def view_direction(view: str | None, *, up: Up) -> tuple[float, ...] | None:
    """Parse the direction to the viewer: a name, two angles in degrees, or a vector."""
    if view is None:
        return None
    if view in AROUND:
        return named_direction(view, up=up)
    found = _numbers(view)
    if len(found) == 2:
        return direction_of_angles(*found, up=up)
    if len(found) != 3 or not any(found):
        raise typer.BadParameter(
            f"--view {view}: write a direction such as 0.5,0.4,0.8, two angles such as 30,20, or one of "
            f"{', '.join(AROUND)}"
        )
    return found


def numbers(option: str, text: str | None, count: int) -> tuple[float, ...] | None:
    """Parse finite numbers separated by commas."""
    if text is None:
        return None
    found = _numbers(text)
    if len(found) != count:
        raise typer.BadParameter(f"{option} {text}: write {count} numbers, such as {','.join(map(str, range(count)))}")
    return found


def crops(texts: Sequence[str] | None) -> list[tuple[float, float, float]]:
    """Parse the parts of the picture to enlarge."""
    return [cast(tuple[float, float, float], numbers("--crop", text, 3)) for text in texts or ()]


def _numbers(text: str) -> tuple[float, ...]:
    """Parse numbers separated by commas; return an empty tuple if one of them is invalid."""
    try:
        found = tuple(map(float, text.split(",")))
    except ValueError:
        return ()
    return found if all(map(isfinite, found)) else ()
