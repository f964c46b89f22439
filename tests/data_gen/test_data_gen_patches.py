import numpy as np
from shapes import grid, icosphere

from cascadenorm.data_gen.meshing.patches import training_patches
from cascadenorm.mesh import part_of


def test_patches_have_every_face_once_and_at_most_so_many():
    mesh = icosphere(4)
    found = training_patches(mesh, faces=700)
    assert max(map(len, found)) <= 700 < 2 * min(map(len, found))
    np.testing.assert_array_equal(np.sort(np.concatenate(found)), np.arange(len(mesh.faces)))


def test_a_small_mesh_is_one_patch():
    mesh = grid(3, 3)
    (only,) = training_patches(mesh, faces=len(mesh.faces))
    np.testing.assert_array_equal(part_of(mesh, only)[0].corners, mesh.corners)


def test_a_piece_has_the_faces_where_they_were_and_no_other_vertices():
    mesh = icosphere(3)
    for chosen in training_patches(mesh, faces=100):
        part, _ = part_of(mesh, chosen)
        np.testing.assert_array_equal(part.corners, mesh.corners[chosen])
        assert len(np.unique(part.faces)) == len(part.vertices) < len(mesh.vertices)


def test_a_strip_is_cut_across_its_length():
    mesh = grid(40, 2)
    longest = np.argmax(np.ptp(mesh.vertices, axis=0))
    (first, second) = training_patches(mesh, faces=len(mesh.faces) // 2)
    assert mesh.centroids[first, longest].max() <= mesh.centroids[second, longest].min()
