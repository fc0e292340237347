"""Evidence of leaves that are there, of leaves that are not, and of pieces of a wall."""

from dataclasses import replace

import numpy as np
import pytest
from usdfoliage.capture.view import View
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.segmentation.dense.evidence import EvidenceSettings, weigh_evidence

from tests.support.leaves.captures import known_foliage
from tests.support.leaves.shapes import flat_leaf
from tests.support.leaves.views import camera


@pytest.fixture(scope="module")
def known():
    return known_foliage()


@pytest.fixture(scope="module")
def depths(known):
    return [view.depth_m for view in known.views]


def moved(leaves: Leaves, by_m: np.ndarray) -> Leaves:
    return replace(leaves, base_m=leaves.base_m + by_m)


def on_wall(scale: float = 1.0) -> tuple[Leaves, View, np.ndarray]:
    """A flat leaf 6 cm long on a wall 1 m away, the view and its depth."""
    leaf = Leaves(
        parameters=flat_leaf(0.4), base_m=np.array([[0.0, -0.03, 1.0]]) * scale,
        orientation=np.array([[0.0, 0, 0, 1]]), length_m=np.array([0.06]) * scale, phase=np.zeros(1),
    )  # fmt: skip
    cam: Pinhole = camera(scale=scale)
    depth = np.full((cam.height_px, cam.width_px), 1.0 * scale, np.float32)
    return leaf, View(name="wall.png", camera=cam, srgb=np.zeros((*depth.shape, 3), np.uint8), depth_m=depth), depth


def test_true_leaves_are_seen_and_end_where_they_end(known, depths):
    found = weigh_evidence(known.leaves, known.views, depths, 0.0)
    clear = known.visible > 0.8
    assert clear.sum() > 20
    assert (found.on[clear] > 0.9).all()
    assert np.quantile(found.violated, 0.9) < 0.05
    assert np.median(found.free[clear]) > 0.9
    assert np.median(found.continued[clear]) < 0.05
    assert found.on + found.violated + found.unseen == pytest.approx(np.ones(len(known.leaves)))


def test_probes_lie_on_the_leaves(known, depths):
    found = weigh_evidence(known.leaves, known.views, depths, 0.0)
    count = len(known.leaves)
    assert found.points_m.shape == found.normals.shape == (count, 112, 3)
    assert found.areas_m2.sum(axis=1) == pytest.approx(found.area_m2)
    assert np.linalg.norm(found.normals, axis=-1) == pytest.approx(1)
    assert (found.areas_m2 * found.seen).sum(axis=1) == pytest.approx(found.on * found.area_m2)
    finer = weigh_evidence(known.leaves, known.views, depths, 0.0, EvidenceSettings(columns=40, rows=60))
    assert found.area_m2 == pytest.approx(finer.area_m2, rel=0.03)


@pytest.mark.parametrize("scale", [0.1, 1.0, 10.0])
def test_a_piece_of_wall_goes_on(scale):
    leaf, view, depth = on_wall(scale)
    found = weigh_evidence(leaf, [view], [depth], 0.0)
    assert found.on == pytest.approx([1])
    assert found.free == pytest.approx([0])
    assert found.continued == pytest.approx([1])
    # the silhouette is a quartic whose three inner control points stand at the width and count a fifth each
    assert found.area_m2 == pytest.approx([2 * 0.4 * 3 / 5 * (0.06 * scale) ** 2], rel=0.02)


@pytest.mark.parametrize("scale", [0.1, 1.0, 10.0])
def test_a_leaf_before_what_is_seen_is_violated_and_one_behind_unseen(scale):
    leaf, view, depth = on_wall(scale)
    before = weigh_evidence(moved(leaf, np.array([0, 0, -0.05 * scale])), [view], [depth], 0.0)
    behind = weigh_evidence(moved(leaf, np.array([0, 0, 0.05 * scale])), [view], [depth], 0.0)
    assert before.violated == pytest.approx([1])
    assert behind.unseen == pytest.approx([1])
    for found in (before, behind):
        assert not found.seen.any()
        assert found.free[0] == found.continued[0] == 0


def test_noise_widens_what_counts_as_on():
    leaf, view, depth = on_wall()
    leaf = moved(leaf, np.array([0, 0, -0.005]))
    assert weigh_evidence(leaf, [view], [depth], 0.0).violated == pytest.approx([1])
    assert weigh_evidence(leaf, [view], [depth], 0.002).on == pytest.approx([1])
    assert weigh_evidence(leaf, [view], [depth], [0.002]).on == pytest.approx([1])


def test_views_outvote_each_other():
    leaf, view, depth = on_wall()
    through = np.full_like(depth, 1.5)
    tie = weigh_evidence(leaf, [view, view], [depth, through], 0.0)
    lost = weigh_evidence(leaf, [view] * 3, [depth, through, through], 0.0)
    assert tie.on == pytest.approx([1])
    assert lost.violated == pytest.approx([1])


def test_threads_do_not_matter(known, depths):
    one, three = (weigh_evidence(known.leaves, known.views, depths, 0.0, threads=n) for n in (1, 3))
    for name in ("on", "violated", "free", "continued", "area_m2", "seen"):
        assert np.array_equal(getattr(one, name), getattr(three, name))


def test_no_leaves_no_views_and_leaves_out_of_sight(known, depths):
    none = weigh_evidence(known.leaves.take(np.zeros(0, int)), known.views, depths, 0.0)
    assert none.on.shape == none.free.shape == (0,)
    assert none.points_m.shape == (0, 112, 3)
    for views, maps in (([], []), (known.views[:1], [np.zeros_like(depths[0])])):
        assert weigh_evidence(known.leaves, views, maps, 0.0).unseen == pytest.approx(np.ones(len(known.leaves)))
    behind = moved(known.leaves, np.array([0, 0, 50.0]) - 50 * known.views[0].camera.cam_from_world[2, :3])
    assert weigh_evidence(behind, known.views[:1], depths[:1], 0.0).on.max() == 0


def test_wrong_arguments_are_refused(known, depths):
    with pytest.raises(ValueError, match="shorter"):
        weigh_evidence(known.leaves, known.views, depths[:-1], 0.0)
    for wrong in ({"columns": 0}, {"offset": 0.0}, {"noises": -1.0}):
        with pytest.raises(ValueError, match="not"):
            EvidenceSettings(**wrong)
