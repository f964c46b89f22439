"""The classical denoising methods, one module a family; importing this package registers them."""

from cascadenorm.baselines import (
    anisotropic_diffusion,
    bilateral_normal,
    bilateral_normal_global,
    bilateral_vertex,
    curvature_flow,
    diffusion,
    fairing,
    guided_normal,
    l0,
    mean_normal,
    median_normal,
    prescribed_mean_curvature,
    rolling_guidance,
    spectral,
    taubin,
    tv_normal,
)

__all__ = [
    "anisotropic_diffusion",
    "bilateral_normal",
    "bilateral_normal_global",
    "bilateral_vertex",
    "curvature_flow",
    "diffusion",
    "fairing",
    "guided_normal",
    "l0",
    "mean_normal",
    "median_normal",
    "prescribed_mean_curvature",
    "rolling_guidance",
    "spectral",
    "taubin",
    "tv_normal",
]
