import numpy as np
import pytest
from usdfoliage.leaf.segmentation.paper.candidates import CandidateSettings, measure_shapes, plane_frames, segment_view
from usdfoliage.leaf.segmentation.paper.planes import fit_planes
from usdfoliage.leaf.segmentation.paper.superpixels import SuperpixelSettings

from tests.support.leaves.views import Disc, draw_view

DELTA = 0.018


def shape_of(view, owner, leaf=0):
    """The shape of what a view shows of one leaf, all of it one superpixel."""
    labels = np.where(owner == leaf, 0, -1).astype(np.int32)
    points = view.points()
    planes = fit_planes(points, labels, view.camera.position_m, DELTA, rng=np.random.default_rng(0))
    return measure_shapes(points, labels, np.zeros(1, np.int32), planes, view.camera)


@pytest.mark.parametrize(("turn", "tilt"), [(0, 0), (0.7, 0), (0.3, 0.6), (1.5, -0.8)])
def test_an_ellipse_fills_its_ellipse(turn, tilt):
    disc = Disc(center=(0.01, -0.005, 1.0), half=(0.06, 0.025), turn=turn, tilt=tilt)
    view, owner = draw_view([disc])
    shape = shape_of(view, owner)
    assert shape.confidence[0] > 0.96
    np.testing.assert_allclose(shape.half_axes_m[0], disc.half, rtol=0.03)
    np.testing.assert_allclose(shape.centers_m[0], disc.center, atol=0.001)
    assert shape.areas_m2[0] == pytest.approx(np.pi * np.prod(disc.half), rel=0.03)
    assert abs(shape.axes[0, 0] @ disc.axes[0]) == pytest.approx(1, abs=2e-3)
    assert shape.axes[0, 2] @ (0, 0, 1) < 0  # towards the camera
    assert np.linalg.det(shape.axes[0]) == pytest.approx(1)


def test_crescents_and_crossed_leaves_are_not_trusted():
    disc = Disc(center=(0, 0, 1.0), half=(0.06, 0.04))
    view, owner = draw_view([disc, Disc(center=(0.01, 0.018, 0.9), half=(0.06, 0.04))])
    assert shape_of(view, owner).confidence[0] < 0.65
    crossed = [Disc(center=(0, 0, 1), half=(0.07, 0.012), turn=turn) for turn in (0.0, 1.2)]
    view, owner = draw_view(crossed)
    assert shape_of(view, np.minimum(owner, 0)).confidence[0] < 0.55


def test_confidence_does_not_depend_on_scale():
    disc = Disc(center=(0.01, 0, 1.0), half=(0.06, 0.025), tilt=0.4)
    values = []
    for scale in (0.1, 1.0, 10.0):
        view, owner = draw_view([disc], scale=scale)
        labels = np.where(owner == 0, 0, -1).astype(np.int32)
        points = view.points()
        planes = fit_planes(points, labels, view.camera.position_m, DELTA * scale, rng=np.random.default_rng(0))
        values.append(measure_shapes(points, labels, np.zeros(1, np.int32), planes, view.camera).confidence[0])
    assert values == pytest.approx([values[1]] * 3, abs=1e-5)


def test_leaves_of_a_view():
    discs = [
        Disc(center=(-0.05, 0, 1.0), tilt=0.3, turn=0.4),
        Disc(center=(-0.03, 0.02, 1.05), tilt=-0.4, turn=1.0),  # partly behind the first
        Disc(center=(0.06, 0, 0.95), tilt=-0.5, turn=-0.5),
    ]
    view, owner = draw_view(discs, noise_m=0.0003)
    found = segment_view(view, DELTA, SuperpixelSettings(size_px=8), rng=np.random.default_rng(0))
    labels = found.candidates.labels
    assert len(found.candidates.confidence) == labels.max() == len(found.shapes.centers_m)
    for number in range(3):
        truth = owner == number
        share = max(
            np.count_nonzero(truth & (labels == k)) / np.count_nonzero(truth | (labels == k))
            for k in range(1, labels.max() + 1)
        )
        assert share > 0.85


def test_a_wall_is_too_large_for_a_leaf():
    view, _ = draw_view([Disc(center=(0, 0, 1), half=(2, 2))])
    found = segment_view(view, DELTA, rng=np.random.default_rng(0))
    assert found.dropped["components too large for a leaf"] == 1
    assert len(found.candidates.confidence) == 0
    with pytest.raises(ValueError, match="max_share"):
        CandidateSettings(max_share=0)


def test_frames_of_points():
    places = np.random.default_rng(1).uniform(-1, 1, (300, 2)) * (3, 1)
    points = np.column_stack([places[:, 1], places[:, 0], np.full(300, 5.0)])
    means, axes = plane_frames(np.concatenate([points, points + 7]), np.array([0, 300, 600]), np.zeros(3))
    np.testing.assert_allclose(means[1] - means[0], [7, 7, 7])
    assert abs(axes[0, 0] @ (0, 1, 0)) > 0.99
    np.testing.assert_allclose(axes[:, 2], [[0, 0, -1]] * 2, atol=1e-9)
