import numpy as np
import pytest
from usdfoliage.leaf.points import FREE_EDGE, HIDDEN_EDGE, INTERIOR
from usdfoliage.leaf.segmentation.paper.candidates import segment_view
from usdfoliage.leaf.segmentation.paper.refinement import (
    RefinementSettings,
    distance_to_ellipse,
    find_edges,
    refine_leaves,
)
from usdfoliage.leaf.segmentation.paper.superpixels import SuperpixelSettings
from usdfoliage.leaf.segmentation.paper.template import draw_template

from tests.support.leaves.views import Disc, camera, draw_view

DELTA = 0.018


def refine(discs, xs=(0.0,), ratio=2.5, **kwargs):
    drawn = [draw_view(discs, camera(x=x)) for x in xs]
    views = [view for view, _ in drawn]
    found = [segment_view(view, DELTA, SuperpixelSettings(size_px=8), rng=np.random.default_rng(0)) for view in views]
    return refine_leaves(views, found, draw_template(ratio), DELTA, RefinementSettings(**kwargs)), drawn


def test_distance_to_an_ellipse():
    half = np.array([3.0, 1.0])
    angle = np.linspace(0, 2 * np.pi, 50)
    on = np.column_stack([np.cos(angle), np.sin(angle)]) * half
    normal = np.column_stack([np.cos(angle), np.sin(angle)]) / half
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    for away in (0.1, 1.0, 4.0):
        np.testing.assert_allclose(distance_to_ellipse(on + away * normal, half), away, rtol=2e-3)
    assert (distance_to_ellipse(0.99 * on, half) == 0).all()
    assert len(distance_to_ellipse(np.empty((0, 2)), half)) == 0


def test_a_leaf_seen_by_two_views_is_one_leaf():
    disc = Disc(center=(0, 0, 1.0), half=(0.05, 0.02), turn=0.5, tilt=0.3)
    refined, drawn = refine([disc], xs=(-0.02, 0.02))
    assert len(refined.leaves) == 1
    assert sum(refined.dropped.values()) == 1
    assert refined.length_m[0] == pytest.approx(0.1, rel=0.05)
    motion = refined.world_from_template[0]
    assert abs(motion[:, 0] @ disc.axes[0]) > 0.999
    np.testing.assert_allclose(motion[:, 3], disc.center, atol=0.002)
    assert np.count_nonzero(refined.leaves.point_view == 0) > 0.9 * np.count_nonzero(drawn[0][1] == 0)
    assert np.count_nonzero(refined.leaves.point_view == 1) > 0.9 * np.count_nonzero(drawn[1][1] == 0)
    facing = np.einsum("pi,pi->p", refined.leaves.normals, -refined.leaves.points_m)
    assert (facing > 0).all()


def test_what_one_view_hides_comes_from_another():
    hidden = Disc(center=(0, 0, 1.0), half=(0.05, 0.02))
    before = Disc(center=(0.02, 0.02, 0.8), half=(0.03, 0.02), turn=1.2, tilt=1.0)
    refined, drawn = refine([hidden, before], xs=(0.0, -0.06))
    points, views = refined.leaves.points_m, refined.leaves.point_view
    of_hidden = np.abs(points[:, 2] - 1.0) < 1e-3
    for view in (0, 1):
        assert np.count_nonzero(of_hidden & (views == view)) > 0.5 * np.count_nonzero(drawn[view][1] == 0)


def test_two_leaves_end_to_end_get_a_template_of_one():
    discs = [Disc(center=(-0.048, 0, 1.0)), Disc(center=(0.048, 0, 1.0))]
    refined, _ = refine(discs)
    assert refined.length_m[0] == pytest.approx(0.1, rel=0.25)  # both together are 0.2 m long
    assert abs(refined.world_from_template[0][0, 3]) == pytest.approx(0.048, abs=0.012)


def test_each_point_is_claimed_once_and_scale_does_not_matter():
    discs = [Disc(center=(-0.04, 0, 1.0), tilt=0.3, turn=0.4), Disc(center=(0.05, 0.01, 1.1), tilt=-0.4)]
    counts = []
    for scale in (0.1, 1.0, 10.0):
        view, _ = draw_view(discs, scale=scale)
        found = segment_view(view, DELTA * scale, SuperpixelSettings(size_px=8), rng=np.random.default_rng(0))
        refined = refine_leaves([view], [found], draw_template(2.5), DELTA * scale)
        assert len(np.unique(refined.leaves.points_m, axis=0)) == len(refined.leaves.points_m)
        counts.append(np.diff(refined.leaves.offsets).tolist())
    assert len(counts[0]) == 2
    np.testing.assert_allclose(counts[0], counts[1], rtol=0.01)
    np.testing.assert_allclose(counts[2], counts[1], rtol=0.01)


def test_what_is_dropped():
    disc = Disc(center=(0, 0, 1.0))
    refined, _ = refine([disc], min_confidence=1.0)
    assert dict(refined.dropped) == {"candidates of little confidence": 1}
    assert len(refined.leaves) == 0
    assert refined.world_from_template.shape == (0, 3, 4)
    refined, _ = refine([disc], min_points=100_000)
    assert dict(refined.dropped) == {"duplicates and candidates of few points": 1}
    view, _ = draw_view([disc])
    assert len(refine_leaves([view], [None], draw_template(2.0), DELTA).leaves) == 0
    with pytest.raises(ValueError, match="min_matched"):
        RefinementSettings(min_matched=2)


def test_kinds_of_edges():
    owner = np.full((6, 8), -1, np.int32)
    owner[1:5, 0:5] = 0
    depth = np.full((6, 8), 2.0, np.float32)
    depth[owner == 0] = 1.0
    depth[:, 5] = 0.5  # something before the leaf
    kind = find_edges(owner, depth)
    assert (kind[1:5, 4] == HIDDEN_EDGE).all()
    assert (kind[1:5, 0] == HIDDEN_EDGE).all()  # the picture ends
    assert (kind[1, 1:4] == FREE_EDGE).all()
    assert (kind[4, 1:4] == FREE_EDGE).all()
    assert (kind[2:4, 1:4] == INTERIOR).all()
