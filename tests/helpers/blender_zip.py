"""The script that builds the extension of Blender, as a module."""

import importlib.util
from pathlib import Path

_file = Path(__file__).parents[2] / "release" / "blender" / "build.py"
_specification = importlib.util.spec_from_file_location("blender_build", _file)
assert _specification is not None and _specification.loader is not None
build = importlib.util.module_from_spec(_specification)
_specification.loader.exec_module(build)
