"""A USD scene, and layers as OpenUSD reads and writes them."""

import io as streams
import zipfile

import numpy as np
from sample_files import read

from cascadenorm import io

SCENE = """#usda 1.0
(
    defaultPrim = "root"
    metersPerUnit = 0.01
    upAxis = "Z"
)

def Xform "root" (
    kind = "component"
)
{
    double3 xformOp:translate = (10, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]

    def Mesh "roof"
    {
        float3[] extent = [(0, 0, 0), (2, 1, 1)]
        int[] faceVertexCounts = [4, 4]
        int[] faceVertexIndices = [0, 1, 4, 3, 1, 2, 5, 4]
        normal3f[] normals = [(0, -0.7071, 0.7071), (0, 0.7071, 0.7071)] (
            interpolation = "uniform"
        )
        point3f[] points = [(0, 0, 0), (1, 0, 1), (2, 0, 0), (0, 1, 0), (1, 1, 1), (2, 1, 0)]
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1), (0, 0), (1, 0), (1, 1), (0, 1)] (
            interpolation = "faceVarying"
        )
        rel material:binding = </root/paint>
    }

    def "again" (
        instanceable = true
        references = </root/roof>
    )
    {
        double3 xformOp:translate = (0, 5, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }

    def Material "paint"
    {
        asset inputs:file = @paint.png@
    }
}
"""


def stored(data: bytes, format: str) -> bytes:
    """Return a layer in text in another format."""
    made = streams.BytesIO()
    io.write(read(data, "usda"), made, format=format)
    return made.getvalue()


def archive(files: dict[str, bytes]) -> bytes:
    made = streams.BytesIO()
    with zipfile.ZipFile(made, "w") as entries:
        for name, data in files.items():
            entries.writestr(name, data)
    return made.getvalue()


def with_attributes(text: str) -> bytes:
    """Return the scene with further attributes of the roof."""
    return SCENE.replace("        rel material:binding", f"        {text}\n        rel material:binding").encode()


def layer(data: bytes, tmp_path):
    """Return a layer as OpenUSD reads it; what it holds expires with it."""
    from pxr import Sdf

    path = tmp_path / "layer.usd"
    path.write_bytes(data)
    return Sdf.Layer.OpenAsAnonymous(str(path))


def values(data: bytes, prim: str, tmp_path) -> dict[str, np.ndarray]:
    """Return the arrays among the attributes of a prim."""
    found = layer(data, tmp_path)
    attributes = found.GetPrimAtPath(prim).attributes
    return {spec.name: np.array(spec.default) for spec in attributes if spec.typeName.isArray}
