"""Controls that apply to every method.

They set the strength, masks, boundary, creases, detail, displacement limits and volume.
"""

from cascadenorm.controls.settings import CONTROLS, Controls, ControlSetting, checked_controls
from cascadenorm.errors import DenoiseError

__all__ = ["CONTROLS", "ControlSetting", "Controls", "DenoiseError", "checked_controls"]
