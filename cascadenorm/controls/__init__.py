"""What surrounds every method: strength, masks, boundary, creases, detail, limits, volume."""

from cascadenorm.controls.settings import CONTROLS, Controls, ControlSetting, checked
from cascadenorm.errors import DenoiseError

__all__ = ["CONTROLS", "ControlSetting", "Controls", "DenoiseError", "checked"]
