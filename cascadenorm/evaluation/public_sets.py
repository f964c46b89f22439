"""Public sets of noisy and clean meshes, read from local copies."""

import hashlib
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Literal, NamedTuple

from cascadenorm.errors import ParameterError, ReadError
from cascadenorm.io.interop import as_mesh
from cascadenorm.io.pairs import FilePair

Split = Literal["train", "test"]
SPLITS: tuple[Split, ...] = ("train", "test")


class KnownPair(NamedTuple):
    """A pair of a set with known files."""

    # noisy, clean: paths relative to the copy
    noisy: str
    clean: str
    digests: tuple[str, ...] = ()  # `geometry_digest` of the two meshes; empty if unknown


@dataclass(frozen=True, kw_only=True)
class PublicSet:
    """A third-party set of pairs."""

    about: str  # short description
    source: str  # paper and its DOI
    place: str  # where to download it
    listed: dict[str, KnownPair] = field(default_factory=dict)  # pairs by name, all of which are for testing
    # for a set of many files, the folder that contains `train` and `test`, with `original/NAME.obj` and
    # `noisy/NAME_n….obj` in each
    folder: str = ""


def _guided_pair(name: str, *digests: str, clean: str = "") -> KnownPair:
    return KnownPair(f"models/{name}/Noisy.obj", f"models/{clean or name}/Original.obj", digests)


CNR = "Wang, Liu, Tong 2016, doi:10.1145/2980179.2980232"
CNR_PLACE = "https://github.com/zhangyk18/GeoBi-GNN, whose readme links to the archive"

PUBLIC_SETS = {
    "guided": PublicSet(
        about="eight models with Gaussian or impulsive noise",
        source="Zhang et al. 2015, doi:10.1111/cgf.12742",
        place="git clone https://github.com/bldeng/GuidedDenoising",
        listed={
            "block": _guided_pair("Block0.4", "c116ec3be7a1b13f", "758b1de6407d45b8"),
            "bunny": _guided_pair("Bunny0.2", "453713d39ccf3891", "bf780cbd08ce426e"),
            "fandisk03": _guided_pair("Fandisk0.3", "e5340782d793b797", "38ef02f691380d08", clean="Fandisk0.7"),
            "fandisk07": _guided_pair("Fandisk0.7", "93af04e1923dad23", "38ef02f691380d08"),
            "julius": _guided_pair("Julius0.2", "9f2194fcf54355ca", "59fcb18ddf53aa93"),
            "nicolo": _guided_pair("Nicolo0.2", "33aa7da34548d505", "8fd02ad21ce656e1"),
            "sharpsphere": _guided_pair("SharpSphere0.3", "0f400699d6b9ba0a", "555825375ca16ec6"),
            "twelve": _guided_pair("Twelve0.5Impulsive", "30dc7689f8ae308e", "fa65d8c5aba732ba"),
        },
    ),
    "mesh-tgv": PublicSet(
        about="two scans of a Kinect and two models with Gaussian noise",
        source="Liu et al. 2022, the program for mesh TGV",
        place="git clone https://github.com/LabZhengLiu/MeshTGV",
        listed={
            "kinect_cone": KnownPair(
                "data/Kinect/Cone/noisy.obj",
                "data/Kinect/Cone/cone-GroundTruth.obj",
                ("61856a9202850e68", "c5b19f994994e7a7"),
            ),
            "kinect_pyramid": KnownPair(
                "data/Kinect/Pyramid/noisy.obj", "data/Kinect/Pyramid/pyramid_16-GroundTruth.obj"
            ),
            "block_smooth": KnownPair(
                "data/CAD/Block/block-smooth-RandomDirectionNoise0.35.obj",
                "data/CAD/Block/block-smooth-GroundTruth.obj",
            ),
            "fandisk_tgv": KnownPair("data/CAD/Fandisk/noisy.obj", "data/CAD/Fandisk/groundtruth.obj"),
        },
    ),
    "synthetic": PublicSet(
        about="models with Gaussian noise of 0.1, 0.2 and 0.3 mean edge lengths",
        source=CNR, place=CNR_PLACE, folder="Synthetic",
    ),
    "kinect-v1": PublicSet(about="single scans of a Kinect v1", source=CNR, place=CNR_PLACE, folder="Kinect_v1"),
    "kinect-v2": PublicSet(about="single scans of a Kinect v2", source=CNR, place=CNR_PLACE, folder="Kinect_v2"),
    "kinect-fusion": PublicSet(
        about="scans of a Kinect v1, fused", source=CNR, place=CNR_PLACE, folder="Kinect_Fusion"
    ),
}  # fmt: skip
"""All public sets by name."""


def public_set(name: str) -> PublicSet:
    """Return a public set; raises ParameterError for an unknown name."""
    if name not in PUBLIC_SETS:
        raise ParameterError(f"is {name!r}; it must be one of {', '.join(PUBLIC_SETS)}", parameter="dataset")
    return PUBLIC_SETS[name]


def public_pairs(name: str, copy: str | PathLike[str], *, split: Split = "test") -> list[FilePair]:
    """Return the pairs of a public set in a local copy, by name and split as in its paper.

    The name is one of PUBLIC_SETS, and the copy a folder that contains the clone or the unpacked archive. A set that
    lists its pairs has only the split "test". Raises ParameterError if the set or its split does not exist, and
    ReadError if files are missing or differ from the published meshes.
    """
    wanted, root = public_set(name), Path(copy)
    if split not in SPLITS:
        raise ParameterError(f"is {split!r}; it must be one of {', '.join(SPLITS)}", parameter="split")
    if not root.is_dir():
        raise ReadError(f"{root} is not a folder", hint=f"get the set: {wanted.place}")
    if wanted.folder:
        return _split_pairs(wanted, root, split)
    if split != "test":
        raise ParameterError(f"is {split!r}; the set {name} has only a test split", parameter="split")
    return [_checked(wanted, pair, root, title) for title, pair in wanted.listed.items()]


def geometry_digest(path: Path) -> str:
    """Return a digest of a mesh that is independent of its format, from single precision positions and faces."""
    mesh = as_mesh(path)
    parts = mesh.vertices.astype("<f4").tobytes(), mesh.faces.astype("<i4").tobytes()
    return hashlib.sha256(b"".join(parts)).hexdigest()[:16]


def _checked(wanted: PublicSet, pair: KnownPair, root: Path, title: str) -> FilePair:
    noisy, clean = files = (root / pair.noisy, root / pair.clean)
    for file in files:
        if not file.is_file():
            raise ReadError(f"{file} is missing", hint=f"get the set: {wanted.place}")
    for file, digest in zip(files, pair.digests, strict=bool(pair.digests)):
        if geometry_digest(file) != digest:
            raise ReadError(f"{file} differs from the published mesh", hint=f"get it again: {wanted.place}")
    return FilePair(title, noisy, clean)


def _split_pairs(wanted: PublicSet, root: Path, split: str) -> list[FilePair]:
    """Pair the files of equal names in the folder of the set, which may be the copy itself."""
    place = next((one for one in (root / wanted.folder, root) if (one / split).is_dir()), None)
    if place is None:
        raise ReadError(f"{root} has no folder {wanted.folder}/{split}", hint=f"get the set: {wanted.place}")
    originals = {file.stem: file for file in sorted((place / split / "original").glob("*.obj"))}
    pairs = []
    for file in sorted((place / split / "noisy").glob("*.obj")):
        stem = file.stem.rpartition("_n")[0]
        if stem not in originals:
            raise ReadError(f"{file} has no clean mesh original/{stem}.obj", hint=f"get the set: {wanted.place}")
        pairs.append(FilePair(file.stem, file, originals[stem]))
    if not pairs:
        raise ReadError(f"{place / split} holds no meshes in noisy", hint=f"get the set: {wanted.place}")
    return pairs
