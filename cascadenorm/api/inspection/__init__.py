"""Inspect meshes for defects and noise."""

from cascadenorm.api.inspection.findings import FINDINGS
from cascadenorm.api.inspection.inspection import Inspection, inspect
from cascadenorm.api.inspection.source import Found
from cascadenorm.detection.noise_level import noise_level

__all__ = ["FINDINGS", "Found", "Inspection", "inspect", "noise_level"]
