"""3MF archives and a COLLADA document with nested meshes."""

import io as streams
import zipfile

TETRAHEDRON = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
FACES = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)]
CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"


def mesh_3mf(id: int, *, extra: str = "") -> str:
    """Return an object that is a tetrahedron."""
    vertices = "".join(f'<vertex  z=\'{z}\' x = "{x}" y="{y}" {extra}/>\n' for x, y, z in TETRAHEDRON)
    faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}" pid="9"/>' for a, b, c in FACES)
    return (
        f'<object id="{id}" name="part {id}" type="model"><mesh><!-- <vertex x="5"/> --><vertices>{vertices}</vertices>'
        f"<triangles>{faces}</triangles></mesh></object>"
    )


def nested_3mf(files: dict[str, str | bytes] | None = None) -> bytes:
    """Return an archive in which a part is nested twice in a pair, and the pair twice in the build."""
    pair = (
        '<object id="3" type="model"><components><component objectid="1"/>'
        '<component objectid="1" transform="1 0 0 0 1 0 0 0 1 2 0 0"/></components></object>'
    )
    group = '<object id="4" type="model"><components><component objectid="3"/></components></object>'
    items = '<item objectid="4"/><item objectid="3" transform="-1 0 0 0 1 0 0 0 1 0 5 0"/>'
    model = (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<model unit="inch" xmlns="{CORE}" xmlns:p="{PRODUCTION}">'
        f'<metadata name="Title">é</metadata><resources>{mesh_3mf(1)}{pair}{group}</resources>'
        f"<build>{items}</build></model>"
    )
    made = streams.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in {"3D/3dmodel.model": model, "Metadata/plate.png": "picture", **(files or {})}.items():
            archive.writestr(name, text)
    return made.getvalue()


def entries(data: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(streams.BytesIO(data)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


COLLADA = """<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset><unit meter="0.01"/><up_axis>Z_UP</up_axis></asset>
  <library_images><image id="i"><init_from>./paint.png</init_from></image></library_images>
  <library_geometries><geometry id="g" name="roof"><mesh>
    <source id="p"><float_array id="pa" count="18">
      0 0 0  1 0 1  2 0 0
      0 1 0  1 1 1  2 1 0 </float_array><technique_common><accessor source="#pa" count="6" stride="3">
      <param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor>
      </technique_common></source>
    <source id="n"><float_array id="na" count="6">-0.7071 0 0.7071 0.7071 0 0.7071</float_array><technique_common>
      <accessor source="#na" count="2" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
      <param name="Z" type="float"/></accessor></technique_common></source>
    <source id="t"><float_array id="ta" count="12">0 0 1 0 2 0 0 1 1 1 2 1</float_array><technique_common>
      <accessor source="#ta" count="6" stride="2"><param name="S" type="float"/><param name="T" type="float"/>
      </accessor></technique_common></source>
    <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
    <polylist count="1" material="red"><input semantic="VERTEX" source="#v" offset="0"/>
      <input semantic="NORMAL" source="#n" offset="1"/><input semantic="TEXCOORD" source="#t" offset="2" set="0"/>
      <vcount>4</vcount><p>0 0 0 1 0 1 4 0 4 3 0 3</p></polylist>
    <triangles count="2"><input semantic="VERTEX" source="#v" offset="0"/>
      <input semantic="NORMAL" source="#n" offset="1"/>
      <input semantic="TEXCOORD" source="#t" offset="0" set="0"/><p>1 1 2 1 5 1 1 1 5 1 4 1</p></triangles>
  </mesh></geometry></library_geometries>
  <library_nodes><node id="pair"><instance_geometry url="#g"/>
    <node><translate>0 3 0</translate><instance_geometry url="#g"/></node></node></library_nodes>
  <library_visual_scenes><visual_scene id="s">
    <node><translate>10 0 0</translate><rotate>0 0 1 90</rotate><instance_node url="#pair"/></node>
    <node><scale>-1 1 1</scale><instance_node url="#pair"/></node>
    <node><matrix>1 0 0 0  0 1 0 0  0 0 1 7  0 0 0 1</matrix><instance_geometry url="#g"/></node>
  </visual_scene></library_visual_scenes>
  <scene><instance_visual_scene url="#s"/></scene>
</COLLADA>
"""

MODEL = (
    '<?xml version="1.0"?><model unit="millimeter" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">'
    '<resources><object id="1" type="model"><mesh><vertices><vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/>'
    '<vertex x="0" y="1" z="0"/></vertices><triangles><triangle v1="0" v2="1" v3="2"/></triangles></mesh></object>'
    "</resources><build>%s</build></model>"
)


def archive(model: str, padding: int = 0) -> bytes:
    buffer = streams.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as file:
        relation = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
        file.writestr(
            "_rels/.rels",
            '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
            f'<Relationship Target="/3D/3dmodel.model" Id="r" Type="{relation}"/></Relationships>',
        )
        file.writestr("3D/3dmodel.model", model + " " * padding)
    return buffer.getvalue()
