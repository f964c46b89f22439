"""Denoising inside other programs: datasets of PyVista, pipelines of VTK and ParaView."""
