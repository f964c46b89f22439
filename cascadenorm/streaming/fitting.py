"""Whether a file fits into memory, and the memory for patches where it does not."""

from os import PathLike
from pathlib import Path
from typing import Any

from cascadenorm.controls.settings import checked
from cascadenorm.errors import CascadenormError, ParameterError, ReadError
from cascadenorm.execution.memory import FACE, FREE, amount, free_memory
from cascadenorm.io.atomic import check_output
from cascadenorm.io.files import beside
from cascadenorm.registry import find, registered
from cascadenorm.streaming.ply_rows import ply_tables
from cascadenorm.streaming.stages import LEARNED
from cascadenorm.streaming.stl_records import triangle_count
from cascadenorm.streaming.streaming import STAGED, check_patches

OTHERS = 500
"""Bytes of a face at least while a method works that is not learned, the file included."""


def memory_for_patches(
    source: str | PathLike[str],
    output: str | PathLike[str] | None,
    *,
    method: str,
    force: bool,
    parameters: dict[str, Any],
    controls: dict[str, Any],
) -> tuple[int, str] | None:
    """Return the memory that `denoise_large_file` should take for a file that does not fit, and why, in words.

    Returns
    -------
    None where it fits; where the system does not tell; and for files other than binary PLY and STL, whose faces are not
    known before they are read

    Raises
    ------
    ParameterError : it does not fit, and cannot be denoised in patches
    OutputError : nothing can be written there
    """
    try:
        faces = triangle_count(Path(source)) if Path(source).suffix.lower() == ".stl" else _ply_faces(Path(source))
    except ReadError:
        return None
    need, free = faces * (FACE if method in LEARNED else OTHERS), free_memory()
    if free is None or need <= free:
        return None
    chosen, every = find(method), checked(controls)
    chosen.checked(parameters)
    check_output(beside(Path(source), "denoised") if output is None else Path(output), force=force)
    why = f"{method} needs about {amount(need)} for {faces:,} faces, and {amount(free)} are free"
    try:
        check_patches(source, output, chosen, parameters, every, force=force)
    except CascadenormError as error:
        hint, error.hint = error.hint, ""
        if chosen.name not in STAGED and chosen.receptive_field(parameters, 1) is None:
            able = ", ".join(name for name, known in registered().items() if known.rings is not None or name in STAGED)
            hint = f"choose one of {able} with --memory"
        raise ParameterError(f"{source}: {why}; in patches it cannot be done, since {error}", hint=hint) from error
    return max(1, int(FREE * free)), why


def _ply_faces(path: Path) -> int:
    return ply_tables(path).faces.rows
