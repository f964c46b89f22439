"""The classical denoising methods, one module a family; importing this package registers them."""

from cascadenorm.baselines import bilateral_normal, curvature_flow, diffusion, taubin

__all__ = ["bilateral_normal", "curvature_flow", "diffusion", "taubin"]
