"""Triangle-mesh denoising by cascaded normal regression, beside the classical methods."""
