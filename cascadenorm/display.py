"""What a notebook shows of a mesh; the package sets it, so that meshes need not import what draws them."""

from collections.abc import Callable
from typing import Any

described: Callable[[Any], str] = repr
"""Return HTML that describes a mesh."""
