"""The truth of a measured surface is that of the shape beneath it."""

from measured_fields import measured

from cascadenorm.data_gen.scanning.measured import beneath
from cascadenorm.data_gen.scanning.volumes import segmentation
from cascadenorm.data_gen.shapes import fields

BALL = fields.sphere(radius=0.8)


def test_the_truth_far_from_the_shape_is_unknown():
    made = measured(segmentation, BALL, seed=0, slices=False)
    far = made.noisy.moved(made.noisy.vertices * 1.6)
    assert not beneath(BALL, far, cell=0.05).normals.any()
