"""What users call: meshes, files and regions denoised, compared, filled."""
