"""Draw the picture of docs/other-programs.md: a part of the demonstration denoised and drawn by PyVista, off screen.

    python docs/generate/pyvista_picture.py [FILE]

Needs the extra `pyvista`. VTK draws without a display where it finds EGL or OSMesa.
"""

import sys
from importlib.util import find_spec
from pathlib import Path

import pyvista as pv

PICTURE = Path(__file__).resolve().parents[1] / "pyvista.png"


def main(path: Path = PICTURE) -> None:
    """Draw the noisy, the denoised and the true mesh side by side."""
    package = find_spec("cascadenorm")
    assert package is not None and package.origin is not None
    part = Path(package.origin).parent / "demo_data" / "part"
    noisy, true = pv.read(part / "noisy.ply"), pv.read(part / "clean.ply")
    meshes = {"noisy": noisy, "denoised": noisy.cascadenorm.denoise(), "true": true}
    plotter = pv.Plotter(off_screen=True, shape=(1, len(meshes)), window_size=(1200, 420), border=False)
    for column, (name, mesh) in enumerate(meshes.items()):
        plotter.subplot(0, column)
        plotter.add_mesh(mesh, color="lightsteelblue")
        plotter.add_text(name, font_size=10)
    plotter.link_views()
    plotter.screenshot(path)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
