"""Collect the nine public pairs of README.md from clones of the repositories that hold them (docs/data.md).

python -m benchmarks.accuracy.collect_pairs GuidedDenoising MeshTGV OUT
"""

import argparse
import shutil
from collections.abc import Sequence
from pathlib import Path

from cascadenorm.evaluation.public_sets import public_pairs

OF_TGV = ("kinect_cone",)


def main(arguments: Sequence[str] | None = None) -> None:
    """Copy `noisy.obj` and `clean.obj` of each pair into a folder of its name."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("guided", type=Path, metavar="GuidedDenoising", help="clone of bldeng/GuidedDenoising")
    parser.add_argument("tgv", type=Path, metavar="MeshTGV", help="clone of LabZhengLiu/MeshTGV")
    parser.add_argument("out", type=Path, metavar="OUT", help="folder for the pairs; it is created")
    chosen = parser.parse_args(arguments)
    tgv = [pair for pair in public_pairs("mesh-tgv", chosen.tgv) if pair.name in OF_TGV]
    for pair in [*public_pairs("guided", chosen.guided), *tgv]:
        folder = chosen.out / pair.name
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(pair.noisy, folder / "noisy.obj")
        shutil.copyfile(pair.clean, folder / "clean.obj")
        print(folder)


if __name__ == "__main__":
    main()
