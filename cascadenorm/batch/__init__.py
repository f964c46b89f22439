"""Many files denoised: in processes, as memory allows, resumed where they were interrupted."""
