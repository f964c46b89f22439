"""Blender takes the zip of the extension."""

import subprocess
import sys
from pathlib import Path

import pytest
from blender_zip import build

bpy = pytest.importorskip("bpy", reason="bpy, Blender as a module, is not installed")


def test_blender_takes_the_zip(tmp_path):
    path = build.packed(build.own_wheel(tmp_path), "linux-x64", "3.11", tmp_path)
    (checker,) = Path(bpy.utils.resource_path("LOCAL")).glob("scripts/addons_core/bl_pkg/cli/blender_ext.py")
    done = subprocess.run([sys.executable, checker, "validate", path], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
