"""The noisy ball that tests denoise in Blender, and its positions."""

import numpy as np
import pytest
from shapes import icosphere, noisy

import cascadenorm as cn

bpy = pytest.importorskip("bpy", reason="bpy, Blender as a module, is not installed")

BALL = noisy(icosphere(2), 0.2)
SINGLE = BALL.vertices.astype(np.float32)
RIGHT = SINGLE[:, 0] > 0
METHOD = {"method": "bilateral-normal", "bilateral_normal_iterations": 5}


def positions(elements):
    flat = np.empty(len(elements) * 3, np.float32)
    elements.foreach_get("co", flat)
    return flat.reshape(-1, 3)


def denoised(**controls):
    return cn.denoise(SINGLE, BALL.faces, method="bilateral-normal", iterations=5, **controls)


def denoise(**settings):
    assert bpy.ops.cascadenorm.denoise("EXEC_DEFAULT", True, **{**METHOD, **settings}) == {"FINISHED"}


def active():
    return bpy.context.view_layer.objects.active
