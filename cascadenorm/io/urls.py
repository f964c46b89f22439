"""File names that are URLs."""

import re


def is_url(name: object) -> bool:
    """Whether a name is a URL. "C://" is a drive."""
    return isinstance(name, str) and re.match(r"[A-Za-z][A-Za-z0-9+.-]+://", name) is not None
