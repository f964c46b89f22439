"""Checks of file names from the page, and labels of settings on the page."""

import sys

from cascadenorm.errors import OutputError

MOST_NAME_BYTES = 200  # longest file name, in bytes of UTF-8
REFUSED = "/\\" + (':*?"<>|' if sys.platform == "win32" else "")
"""Characters that separate folders or that file names cannot contain."""


def plain_name(name: object) -> str:
    """Return a file name without folders; raise OutputError for anything else, such as a path."""
    text = name if isinstance(name, str) else ""
    bad = any(letter in REFUSED or ord(letter) < 32 or 0xD800 <= ord(letter) < 0xE000 for letter in text)
    if bad or not text.strip() or text.startswith(".") or len(text.encode(errors="replace")) > MOST_NAME_BYTES:
        raise OutputError(
            f"{name!r} is not a plain file name",
            hint=f"give one without folders and of at most {MOST_NAME_BYTES} bytes, such as part_denoised.ply",
        )
    return text


SETTING_LABELS = {
    "mask": "Displacement weights",
    "fixed": "Fixed vertices",
    "only": "Restrict to faces",
    "boundary": "Boundary vertices",
    "creases": "Crease edges",
    "keep_detail": "Keep details of width",
    "remove_detail": "Remove errors up to width",
    "volume": "Enclosed volume",
    "max_displacement": "Largest displacement",
    "on_bad": "Invalid vertices and faces",
}
"""Labels of settings whose names alone do not say what they are."""


def label(name: str) -> str:
    return SETTING_LABELS.get(name, name.replace("_", " ").capitalize())


def setting_name(name: str, value: object = None) -> str:
    """Return the form's label of a setting in quotes, for messages, with a value where one is given."""
    return f"“{label(name)}”" if value is None else f"“{label(name)}”: {value}"
