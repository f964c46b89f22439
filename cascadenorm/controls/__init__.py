"""What surrounds every method: strength, masks, fixed vertices, boundaries, creases, detail, limits, volume."""

from cascadenorm.controls.controls import Boundary, Controls, DenoiseError, controlled, faces_within, framed_length

__all__ = ["Boundary", "Controls", "DenoiseError", "controlled", "faces_within", "framed_length"]
