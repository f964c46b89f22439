"""Names of files that come from the page, and of settings as the page shows them."""

from cascadenorm.errors import OutputError

MOST_BYTES = 200
"""Longest file name, in bytes of UTF-8."""


def plain_name(name: object) -> str:
    """Return the name of a file in a folder that is known; raises OutputError for anything else, such as a path."""
    bad = not isinstance(name, str) or name.startswith(".") or not name.strip() or len(name.encode()) > MOST_BYTES
    if bad or any(letter in '/\\\\:*?"<>|' or ord(letter) < 32 for letter in str(name)):
        raise OutputError(
            f"{name!r} is not a plain file name", hint="give one without folders, such as part_denoised.ply"
        )
    return str(name)


def label(name: str) -> str:
    """Return the form's label of a setting."""
    return name.replace("_", " ").capitalize()


def spelled(name: str, value: object = None) -> str:
    """Return the form's label of a setting in quotes, for messages, with a value where one is given."""
    return f"“{label(name)}”" if value is None else f"“{label(name)}”: {value}"
