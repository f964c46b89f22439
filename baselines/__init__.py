"""The classical denoising methods, one module a family; importing this package registers them."""

from cascadenorm.baselines import (
    anisotropic,
    bilateral_normal,
    bilateral_vertex,
    curvature_flow,
    diffusion,
    guided_normal,
    l0,
    prescribed,
    taubin,
)

__all__ = [
    "anisotropic",
    "bilateral_normal",
    "bilateral_vertex",
    "curvature_flow",
    "diffusion",
    "guided_normal",
    "l0",
    "prescribed",
    "taubin",
]
