"""Collect the nine public pairs of the README from clones of the repositories that hold them (docs/data.md).

python benchmarks/collect_pairs.py GuidedDenoising MeshTGV OUT
"""

import argparse
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from cascadenorm.interop import as_mesh


class Source(NamedTuple):
    """Where a pair lies in its repository, and how many vertices and faces both of its meshes have."""

    noisy: str
    clean: str
    vertices: int
    faces: int


GUIDED = {
    "block": Source("models/Block0.4/Noisy.obj", "models/Block0.4/Original.obj", 8771, 17550),
    "bunny": Source("models/Bunny0.2/Noisy.obj", "models/Bunny0.2/Original.obj", 34834, 69451),
    "fandisk03": Source("models/Fandisk0.3/Noisy.obj", "models/Fandisk0.7/Original.obj", 6475, 12946),
    "fandisk07": Source("models/Fandisk0.7/Noisy.obj", "models/Fandisk0.7/Original.obj", 6475, 12946),
    "julius": Source("models/Julius0.2/Noisy.obj", "models/Julius0.2/Original.obj", 36201, 71912),
    "nicolo": Source("models/Nicolo0.2/Noisy.obj", "models/Nicolo0.2/Original.obj", 14846, 29437),
    "sharpsphere": Source("models/SharpSphere0.3/Noisy.obj", "models/SharpSphere0.3/Original.obj", 10443, 20882),
    "twelve": Source("models/Twelve0.5Impulsive/Noisy.obj", "models/Twelve0.5Impulsive/Original.obj", 4610, 9216),
}
MESH_TGV = {"kinect_cone": Source("data/Kinect/Cone/noisy.obj", "data/Kinect/Cone/cone-GroundTruth.obj", 31159, 61301)}


def main(arguments: Sequence[str] | None = None) -> None:
    """Copy `noisy.obj` and `clean.obj` of each pair into a folder of its name."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("guided", type=Path, metavar="GuidedDenoising", help="clone of bldeng/GuidedDenoising")
    parser.add_argument("tgv", type=Path, metavar="MeshTGV", help="clone of LabZhengLiu/MeshTGV")
    parser.add_argument("out", type=Path, metavar="OUT", help="folder for the pairs; it is made")
    chosen = parser.parse_args(arguments)
    for clone, pairs in ((chosen.guided, GUIDED), (chosen.tgv, MESH_TGV)):
        for name, source in pairs.items():
            folder = chosen.out / name
            folder.mkdir(parents=True, exist_ok=True)
            for kind, path in (("noisy", source.noisy), ("clean", source.clean)):
                mesh = as_mesh(clone / path)
                if (len(mesh.vertices), len(mesh.faces)) != (source.vertices, source.faces):
                    raise SystemExit(
                        f"{clone / path} has {len(mesh.vertices)} vertices and {len(mesh.faces)} faces; the mesh that "
                        f"was measured has {source.vertices} and {source.faces}"
                    )
                shutil.copyfile(clone / path, folder / f"{kind}.obj")
            print(folder)


if __name__ == "__main__":
    main()
