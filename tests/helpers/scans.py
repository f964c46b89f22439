"""A scanned mesh, and the settings that tests of a studio on it ask for."""

import numpy as np
from shapes import icosphere, noisy
from studios import until

ROUGH = noisy(icosphere(3), 0.2)
LAPLACIAN = {"method": "laplacian", "parameters": {"iterations": "2"}, "controls": {"strength": "0.5"}}


def scanned(path, mesh=ROUGH):
    """Write a PLY file with properties that a result has to keep."""
    count = len(mesh.vertices)
    kinds = [("x", "f4"), ("y", "f4"), ("z", "f4"), ("quality", "f4"), ("label", "u1")]
    vertices = np.empty(count, kinds)
    for name, values in zip("xyz", mesh.vertices.T, strict=True):
        vertices[name] = values
    vertices["quality"], vertices["label"] = np.linspace(0, 1, count), np.arange(count) % 7
    faces = np.empty(len(mesh.faces), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.faces
    head = (
        f"ply\nformat binary_little_endian 1.0\ncomment by hand\nelement vertex {count}\nproperty float x\n"
        "property float y\nproperty float z\nproperty float quality\nproperty uchar label\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    path.write_bytes(head.encode() + vertices.tobytes() + faces.tobytes())
    return path


def settings(**controls):
    return {**LAPLACIAN, "controls": {name: str(value) for name, value in controls.items()}}


def denoised(studio, events, asked, ticket="t"):
    studio.done("/api/denoise", {"settings": asked, "ticket": ticket})
    return until(events, ticket=ticket, type="shown", coarse=False)
