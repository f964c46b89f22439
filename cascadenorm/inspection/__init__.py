"""What is wrong with a mesh, and how noisy it is."""

from cascadenorm.inspection.inspection import Found, Inspection, inspect
from cascadenorm.inspection.noise_level import noise_level

__all__ = ["Found", "Inspection", "inspect", "noise_level"]
