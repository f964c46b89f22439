"""What is good in a mesh is denoised as if the bad vertices and faces were not there."""

import numpy as np
import pytest
import trimesh
from spoiled import BALL, COUNT, ply, spoiled

import cascadenorm as cn
from cascadenorm.mesh import bad_faces, bad_vertices, isolated

METHOD = {"method": "bilateral-normal"}


def test_bad_vertices_and_faces_are_told_from_the_others():
    vertices, faces, touched = spoiled()
    np.testing.assert_array_equal(np.flatnonzero(bad_vertices(vertices)), [7, 30])
    np.testing.assert_array_equal(bad_faces(vertices, faces), touched)
    for huge in (np.array([[0, 1, 2**64 - 1]], np.uint64), np.array([[0, 1, -(2**63)]])):
        assert bad_faces(vertices, huge).all()


def test_the_rest_is_denoised_as_if_the_bad_were_not_there():
    vertices, faces, touched = spoiled()
    out = cn.denoise(vertices, faces, on_bad="isolate", **METHOD)
    assert out[[7, 30]].tobytes() == vertices[[7, 30]].tobytes()
    good = np.delete(np.arange(COUNT), [7, 30])
    renumbered = np.searchsorted(good, faces[~touched])
    expected = cn.denoise(vertices[good], renumbered, **METHOD)
    assert out[good].tobytes() == expected.tobytes()
    assert (expected != vertices[good]).any(axis=1).sum() > 140


def test_only_counts_the_faces_as_they_are_given(tmp_path):
    vertices, faces, touched = spoiled()
    with np.errstate(invalid="ignore"):
        upper = vertices[np.where((faces < 0) | (faces >= COUNT), 0, faces)].mean(axis=1)[:, 2] > 0
    upper[[0, 51, 322]] = True, False, True
    sound, left = isolated(vertices, faces), ~touched
    expected = cn.denoise(sound, only=upper[left], **METHOD).vertices
    moved = (expected != sound.vertices).any(axis=1)
    assert moved.sum() > 50 and not moved[faces[left & ~upper]].any()
    (tmp_path / "bad.ply").write_bytes(ply("binary_little_endian", vertices, faces))
    for chosen in (upper, np.flatnonzero(upper)):
        out = cn.denoise(vertices, faces, on_bad="isolate", only=chosen, **METHOD)
        assert out[moved].tobytes() == expected[moved].tobytes()
        assert out[~moved].tobytes() == vertices[~moved].tobytes()
        out_file = tmp_path / "out.ply"
        cn.denoise_file(tmp_path / "bad.ply", out_file, on_bad="isolate", only=chosen, force=True, **METHOD)
        assert cn.read(out_file).positions.tobytes() == out.tobytes()
    for wrong in (upper[left], [len(faces)]):
        with pytest.raises(cn.ParameterError, match="only "):
            cn.denoise(vertices, faces, on_bad="isolate", only=wrong, **METHOD)


def test_single_precision_keeps_its_bits_too():
    vertices, faces, _ = spoiled()
    single = vertices.astype(np.float32)
    out = cn.denoise(single, faces, on_bad="isolate", **METHOD)
    assert out.dtype == np.float32 and out[[7, 30]].tobytes() == single[[7, 30]].tobytes()


def test_a_sound_mesh_is_denoised_as_ever():
    out = cn.denoise(BALL, on_bad="isolate", **METHOD)
    assert out.vertices.tobytes() == cn.denoise(BALL, **METHOD).vertices.tobytes()


def test_objects_of_other_libraries_are_isolated_too():
    vertices, faces, _ = spoiled()
    bad = np.delete(faces, [0, 51], axis=0)
    mesh = trimesh.Trimesh(vertices, bad, process=False)
    out = cn.denoise(mesh, on_bad="isolate", **METHOD).vertices
    assert out.tobytes() == cn.denoise(vertices, bad, on_bad="isolate", **METHOD).tobytes()


def test_by_default_bad_input_is_an_error():
    vertices, faces, _ = spoiled()
    with pytest.raises(cn.MeshError, match=r"2 of 162 vertices are not finite \(vertices 7, 30\).*isolate"):
        cn.denoise(vertices, faces, **METHOD)
    with pytest.raises(cn.MeshError, match=r"2 faces use vertices that do not exist \(faces 0, 51;.*isolate"):
        cn.denoise(BALL.vertices, faces, **METHOD)


def test_nothing_good_is_an_error_as_well():
    with pytest.raises(cn.MeshError, match="none of the 320 faces is valid"):
        isolated(np.full((COUNT, 3), np.nan), BALL.faces)
    with pytest.raises(cn.MeshError, match="the mesh has no faces"):
        isolated(BALL.vertices, [])


def test_wrong_shapes_and_words_are_refused():
    with pytest.raises(cn.MeshError, match=r"vertices have shape \(2,\)"):
        cn.denoise([1.0, np.nan], BALL.faces, on_bad="isolate")
    with pytest.raises(cn.MeshError, match=r"faces have shape \(1, 2\)"):
        cn.denoise(BALL.vertices, [[0, 1]], on_bad="isolate")
    with pytest.raises(cn.ParameterError, match="on_bad is 'skip'; it must be one of error, isolate"):
        cn.denoise(BALL, on_bad="skip")
