"""The classical denoising methods, one module per family; importing this package registers them."""

# ruff: noqa: F401
from cascadenorm.baselines import (
    anisotropic_diffusion,
    bilateral_normal,
    bilateral_vertex,
    diffusion,
    fairing,
    guided_normal,
    l0,
    mean_normal,
    prescribed_mean_curvature,
    rolling_guidance,
    spectral,
    static_dynamic_normal,
    taubin,
    tgv_normal,
    tv_normal,
)
