"""Hook for the HTML display of meshes in notebooks.

The package sets it, so that meshes need not import the drawing code.
"""

from collections.abc import Callable
from typing import Any

described: Callable[[Any], str] = repr  # returns HTML that describes a mesh
