"""3MF: replace coordinates, as they are before the transforms of the build, and keep everything else."""

import posixpath
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from io import BytesIO
from typing import Any
from zipfile import ZipFile, ZipInfo

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ReadError
from cascadenorm.io.base import MeshFile, Piece
from cascadenorm.io.content import Content, Labels
from cascadenorm.io.libraries import explained, unzipped
from cascadenorm.io.shown import Matrix, joined, placed, placements
from cascadenorm.io.text.number_format import rows_of
from cascadenorm.io.text.text import Edit, as_short, digits_of, edited
from cascadenorm.io.xml.documents import attribute_edits, parse, tree_of
from cascadenorm.mesh import any_in_rows
from cascadenorm.mesh.polygons import Polygons, triangulate

PATH = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06 path"
MODEL = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
RELS = "_rels/.rels"
MATERIALS = ("basematerials", "colorgroup", "texture2dgroup", "compositematerials", "multiproperties")
SAMPLE = 1000

Reference = tuple[str, str]  # model and id of an object
Use = tuple[Reference, Matrix]  # an object as part of another one or of the build, with its transform


class PrintModel:
    """A model of an archive, parsed on construction: its objects by id, those to be printed, and its unit of length."""

    def __init__(self, name: str, data: bytes) -> None:
        self.name, self.data = name, data
        self.objects: dict[str, PrintObject] = {}
        self.build: list[Use] = []
        self.unit, self.has_materials = "millimeter", False
        self._object: PrintObject | None = None
        self._namespace = ""
        try:
            parse(data, self._start, self._end)
            for found in self.objects.values():
                found.polygons  # noqa: B018 - may overflow
        except KeyError as error:
            raise ReadError(f"an element of this 3mf file lacks the attribute {error}: export the file again") from None
        except OverflowError:
            raise ReadError("a number of this 3mf file is too large: export the file again") from None

    def _start(self, full_name: str, attributes: dict[str, str], at: int) -> None:
        namespace, _, name = full_name.rpartition(" ")
        if name == "model" and not self._namespace:
            self._namespace, self.unit = namespace, attributes.get("unit", self.unit)
        self.has_materials |= name in MATERIALS
        if namespace != self._namespace:  # an element of an extension
            return
        into = self._object
        if name == "vertex" and into is not None:
            into.places.append(at)
            words = attributes["x"], attributes["y"], attributes["z"]
            into.coordinates += map(float, words)
            if len(into.places) < SAMPLE:
                into.digits = max(into.digits, *(digits_of(word.encode()) for word in words))
        elif name == "triangle" and into is not None:
            into.corners += (int(attributes["v1"]), int(attributes["v2"]), int(attributes["v3"]))
        elif name == "object":
            self._object = PrintObject(attributes.get("name", ""))
            self.objects.setdefault(attributes["id"], self._object)
        elif name == "component" and into is not None:
            into.components.append(self._use(attributes))
        elif name == "item":
            self.build.append(self._use(attributes))

    def _end(self, full_name: str, at: int) -> None:
        if full_name.rpartition(" ")[2] == "object":
            self._object = None

    def _use(self, attributes: dict[str, str]) -> Use:
        matrix = np.eye(4)
        if "transform" in attributes:
            numbers = np.array([float(word) for word in attributes["transform"].split()])
            if numbers.shape != (12,):
                raise ReadError("a transform of this 3mf file has not 12 numbers: export the file again")
            matrix[:3] = numbers.reshape(4, 3).T
        return (attributes.get(PATH, self.name).lstrip("/"), attributes["objectid"]), matrix


@dataclass
class PrintObject:
    """An object of a model: a mesh or components."""

    name: str
    digits: int = 0  # largest number of significant digits of a coordinate
    places: list[int] = field(default_factory=list)  # byte offsets of the vertex elements
    coordinates: list[float] = field(default_factory=list)  # three numbers for each vertex
    corners: list[int] = field(default_factory=list)  # three numbers for each triangle
    components: list[Use] = field(default_factory=list)

    @property
    def vertices(self) -> NDArray[np.float64]:
        """(k, 3), after the model is parsed."""
        return np.array(self.coordinates).reshape(-1, 3)

    @cached_property
    def polygons(self) -> Polygons:
        """The triangles, after the model is parsed."""
        return Polygons.from_rows(np.array(self.corners, np.int64).reshape(-1, 3))


class ThreemfFile(MeshFile):
    """A 3MF file. Positions are float32 if that holds all their digits, otherwise float64."""

    format = "3mf"

    def _parse(self) -> tuple[NDArray[Any], Polygons]:
        files = dict(unzipped(self.data, "3mf", lambda name: name == RELS or name.lower().endswith(".model")))
        relations = files.pop(RELS, b"")
        self._models = {name: PrintModel(name, data) for name, data in files.items()}
        self._root = _root_of(relations, list(files))
        self._objects = {
            (name, id): found
            for name, model in self._models.items()
            for id, found in model.objects.items()
            if found.places and found.corners
        }
        if not self._objects:
            raise ReadError("there is no mesh in this 3mf file: export it again")
        objects = self._objects.values()
        sizes = [len(found.places) for found in objects]
        self._first = dict(zip(self._objects, np.cumsum([0, *sizes]).tolist(), strict=False))
        self.parts = np.repeat(np.arange(len(sizes)), sizes) if len(sizes) > 1 else None
        digits = max(found.digits for found in objects)
        whole = joined([Content(found.vertices, found.polygons) for found in objects])
        return as_short(whole.positions, digits), whole.polygons

    def _moved_pieces(self) -> Iterable[Piece]:
        changed = self._changed
        moved = any_in_rows(changed)
        parts: dict[str, list[Edit]] = {}
        for (name, id), found in self._objects.items():
            data, edits, first = self._models[name].data, parts.setdefault(name, []), self._first[name, id]
            rows = np.flatnonzero(moved[first : first + len(found.places)])
            words = rows_of(self.positions[first + rows])
            for row, row_words in zip(rows.tolist(), words, strict=False):
                values = zip((b"x", b"y", b"z"), row_words.split(b" "), changed[first + row], strict=True)
                edits += attribute_edits(data, found.places[row], {key: word for key, word, new in values if new})
        new = {name: b"".join(edited(self._models[name].data, edits)) for name, edits in parts.items() if edits}
        return [_repacked(self.data, new)]

    def face_labels(self) -> list[Labels]:
        objects = self._objects.values()
        return [Labels.of_parts("object", [one.name for one in objects], [len(one.polygons) for one in objects])]

    def _read_content(self) -> Content:
        def inner(reference: Reference) -> list[Use]:
            model = self._models.get(reference[0])
            found = model.objects.get(reference[1]) if model else None
            return found.components if found else []

        def nbytes(reference: Reference) -> int:
            found = self._objects.get(reference)
            return 24 * (len(found.places) + len(found.polygons)) if found else 0

        build = self._models[self._root].build if self._root in self._models else []
        places = [use for use in placements(build, inner, nbytes, len(self.data)) if use[0] in self._objects]
        places = places or [(reference, np.eye(4)) for reference in self._objects]  # a library, or an empty build
        shown = [placed(self._shape(reference), matrix) for reference, matrix in places]
        left_out = ["materials and colours"] if any(model.has_materials for model in self._models.values()) else []
        left_out += ["the unit"] if any(model.unit != "millimeter" for model in self._models.values()) else []
        if set(self._objects) - {reference for reference, _ in places}:
            left_out.append("objects that the build does not contain")
        return joined(shown, left_out)

    def _shape(self, reference: Reference) -> Content:
        first, found = self._first[reference], self._objects[reference]
        return Content(self.positions[first : first + len(found.places)], found.polygons)

    @classmethod
    def encode(cls, content: Content) -> tuple[Iterable[Piece], list[str]]:
        """Write the triangles of content as one object."""
        triangles, _ = triangulate(content.positions, content.polygons)
        vertices = [b'<vertex x="%b" y="%b" z="%b"/>' % tuple(row.split(b" ")) for row in rows_of(content.positions)]
        faces = [b'<triangle v1="%d" v2="%d" v3="%d"/>' % tuple(row) for row in triangles.tolist()]
        model = MODEL_TEMPLATE % (b"\n".join(vertices), b"\n".join(faces))
        made = BytesIO()
        with ZipFile(made, "w") as archive:
            for name, data in (("[Content_Types].xml", CONTENT_TYPES), (RELS, RELATIONS), ("3D/3dmodel.model", model)):
                entry = ZipInfo(name)  # dated 1980, so that the bytes depend only on the mesh
                entry.compress_type = 8
                archive.writestr(entry, data)
        return [made.getvalue()], content.lost_as_triangles(single=False)


def _root_of(relations: bytes, names: list[str]) -> str:
    """Return the name of the model to be printed."""
    related = [element.attributes for element in tree_of(relations).within()] if relations else []
    targets = [one["Target"] for one in related if one.get("Type") == MODEL and "Target" in one]
    declared = [posixpath.normpath(target.lstrip("/")) for target in targets]
    usual = [name for name in names if name.lower() == "3d/3dmodel.model"]
    return next(iter([*(name for name in declared if name in names), *usual, *names]), "")


def _repacked(data: bytes, new: dict[str, bytes]) -> bytes:
    """Return an archive in which the content of some files is replaced. Raises ReadError if another one is damaged."""
    made = BytesIO()
    damaged = explained("another file in this 3mf archive is damaged", hint="get a complete copy")
    with damaged, ZipFile(BytesIO(data)) as source, ZipFile(made, "w") as target:
        target.comment = source.comment
        for entry in source.infolist():
            target.writestr(entry, new.get(entry.filename, source.read(entry)), compress_type=entry.compress_type)
    return made.getvalue()


MODEL_TEMPLATE = b"""<?xml version="1.0" encoding="UTF-8"?>
<model unit="millimeter" xml:lang="en-US" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">
<resources>
<object id="1" type="model">
<mesh>
<vertices>
%b
</vertices>
<triangles>
%b
</triangles>
</mesh>
</object>
</resources>
<build>
<item objectid="1"/>
</build>
</model>
"""

RELATIONS = (
    b'<?xml version="1.0" encoding="UTF-8"?>\n'
    b'<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    b'<Relationship Type="%b" Target="/3D/3dmodel.model" Id="rel0"/></Relationships>\n'
) % MODEL.encode()

CONTENT_TYPES = b"""<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">\
<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>\
<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>
"""
