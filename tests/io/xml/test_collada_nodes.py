"""Nodes of COLLADA put the meshes of a scene where they are shown."""

import numpy as np
from sample_files import read
from xml_files import COLLADA


def test_collada_is_shown_where_its_nodes_put_it():
    content = read(COLLADA.encode(), "dae").content()
    assert content.positions.shape == (30, 3)
    assert content.left_out == ("textures", "normals", "the unit", "the up axis")
    roof = np.array([(0, 0, 0), (1, 0, 1), (2, 0, 0), (0, 1, 0), (1, 1, 1), (2, 1, 0)], float)
    turned = np.stack([10 - roof[:, 1], roof[:, 0], roof[:, 2]], axis=1)
    places = [turned, turned - (3, 0, 0), roof * (-1, 1, 1), roof * (-1, 1, 1) + (0, 3, 0), roof + np.array((0, 0, 7))]
    np.testing.assert_allclose(content.positions.reshape(5, 6, 3), places, atol=1e-6)
    assert content.polygons.counts.tolist() == [4, 3, 3] * 5
    assert content.vertex_values["s"].tolist() == [0, 1, 2, 0, 1, 2] * 5
    assert content.vertex_values["t"].tolist() == [0, 0, 0, 1, 1, 1] * 5
    triangles = content.positions[content.polygons.corners[content.polygons.owners % 3 == 1]].reshape(-1, 3, 3)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    assert (normals[:, 2] > 0).all()  # those of mirrored nodes are reversed


def test_cameras_of_collada_may_stand_anywhere():
    camera = '<node><lookat>0 0 1 0 0 0 0 1 0</lookat><instance_camera url="#c"/></node></visual_scene>'
    assert len(read(COLLADA.replace("</visual_scene>", camera).encode(), "dae").content().positions) == 30
