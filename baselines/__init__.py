"""The classical denoising methods, one module a family; importing this package registers them."""

from cascadenorm.baselines import bilateral_normal

__all__ = ["bilateral_normal"]
