"""Inspect meshes for defects and noise."""

from cascadenorm.detection.noise_level import noise_level
from cascadenorm.inspection.findings import FINDINGS
from cascadenorm.inspection.inspection import Inspection, inspect
from cascadenorm.inspection.source import Found

__all__ = ["FINDINGS", "Found", "Inspection", "inspect", "noise_level"]
