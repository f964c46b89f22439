"""Checks of file names from the page, and labels of settings on the page."""

from cascadenorm.errors import OutputError

MOST_BYTES = 200
"""Longest file name, in bytes of UTF-8."""


def plain_name(name: object) -> str:
    """Return a file name without folders; raise OutputError for anything else, such as a path."""
    text = str(name)
    bad = not isinstance(name, str) or text.startswith(".") or not text.strip()
    bad = bad or not 0 < _bytes_in_utf8(text) <= MOST_BYTES
    if bad or any(letter in '/\\\\:*?"<>|' or ord(letter) < 32 for letter in text):
        raise OutputError(
            f"{name!r} is not a plain file name", hint="give one without folders, such as part_denoised.ply"
        )
    return text


def _bytes_in_utf8(text: str) -> int:
    """Count the bytes of a text; 0 for one that UTF-8 cannot hold, with half of a surrogate pair."""
    try:
        return len(text.encode())
    except UnicodeEncodeError:
        return 0


LABELS = {
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
    """Return the form's label of a setting."""
    return LABELS.get(name, name.replace("_", " ").capitalize())


def spelled(name: str, value: object = None) -> str:
    """Return the form's label of a setting in quotes, for messages, with a value where one is given."""
    return f"“{label(name)}”" if value is None else f"“{label(name)}”: {value}"
