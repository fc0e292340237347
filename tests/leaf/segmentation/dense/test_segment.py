"""The method dense on captures whose leaves are known: most are found, once each, and their points are their own."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from usdfoliage.capture.view import View
from usdfoliage.leaf.points import LeafPoints
from usdfoliage.leaf.segmentation.dense.claims import complete_claims
from usdfoliage.leaf.segmentation.dense.segment import segment_dense
from usdfoliage.leaf.segmentation.dense.settings import DenseSegmentationSettings, PassSettings
from usdfoliage.leaf.segmentation.model import Segmentation

from tests.support.leaves.captures import KnownFoliage, known_foliage
from tests.support.leaves.views import Disc, camera, draw_view

LEAVES = (
    Disc(center=(-0.05, -0.02, 1.0), tilt=0.3, turn=0.4),
    Disc(center=(0.05, -0.02, 1.05), tilt=-0.4, turn=1.0),
    Disc(center=(0.0, 0.04, 0.95), tilt=-0.5, turn=-0.5),
)
WALL = Disc(center=(0, 0, 1.3), half=(5, 5), color=(120, 85, 50))


@dataclass(frozen=True, kw_only=True)
class Owners:
    """Which true leaf each found one shows."""

    leaf: NDArray[np.int64]  # (M,), numbers of true leaves, -1 for what is no leaf
    purity: NDArray[np.float64]  # (M,), share of its points that are that leaf's


def owners(known: KnownFoliage, leaves: LeafPoints) -> Owners:
    true = np.zeros(len(leaves.points_m), np.int64)
    for number, (view, ids) in enumerate(zip(known.views, known.leaf_ids, strict=True)):
        mine = leaves.point_view == number
        column, row = view.camera.project(leaves.points_m[mine])[0].astype(np.int64).T
        true[mine] = ids[row, column]
    found = np.repeat(np.arange(len(leaves)), np.diff(leaves.offsets))
    counts = np.zeros((len(leaves), len(known.leaves) + 1))
    np.add.at(counts, (found, true), 1)
    return Owners(leaf=counts.argmax(axis=1) - 1, purity=counts.max(axis=1) / counts.sum(axis=1))


def recall(known: KnownFoliage, found: Owners, visible: NDArray[np.bool_]) -> float:
    return float(np.isin(np.flatnonzero(visible), found.leaf).mean())


def scaled(views: Sequence[View], scale: float) -> list[View]:
    """The views of a world so many times as large."""
    pose = np.array([1, 1, 1, scale])
    return [
        replace(
            view,
            camera=replace(view.camera, cam_from_world=view.camera.cam_from_world * pose),
            depth_m=(view.depth_m * np.float64(scale)).astype(np.float32),
        )
        for view in views
    ]


def blind(view: View) -> View:
    return replace(view, depth_m=np.zeros_like(view.depth_m))


def drawn(discs, noise_m: float = 0.0003) -> list[View]:
    return [draw_view(discs, camera(x=x), noise_m=noise_m, seed=seed)[0] for seed, x in enumerate((-0.03, 0.03))]


def same_points(one: LeafPoints, other: LeafPoints) -> bool:
    return all(np.array_equal(getattr(one, field.name), getattr(other, field.name)) for field in fields(LeafPoints))


def check_plain(segmentation: Segmentation, views: Sequence[View]) -> None:
    """What holds of every segmentation."""
    leaves = segmentation.leaves
    assert np.isfinite(leaves.points_m).all()
    assert np.linalg.norm(leaves.normals, axis=1) == pytest.approx(np.ones(len(leaves.normals)))
    assert (leaves.kind <= 2).all()
    assert ((leaves.confidence >= 0) & (leaves.confidence <= 1)).all()
    assert (np.diff(leaves.offsets) > 0).all()
    assert set(leaves.view) | set(leaves.point_view) <= {n for n, view in enumerate(views) if view.has_depth}
    for number, view in enumerate(views):
        mine = leaves.point_view == number
        towards = view.camera.position_m - leaves.points_m[mine]
        assert (np.sum(leaves.normals[mine] * towards, axis=1) > 0).all()
    assert len(segmentation.candidates) == len(views)
    for candidates, view in zip(segmentation.candidates, views, strict=True):
        assert candidates.labels.shape == view.depth_m.shape
        assert candidates.labels.max() <= len(candidates.confidence)
        assert ((candidates.confidence >= 0) & (candidates.confidence <= 1)).all()
    passes = segmentation.passes
    for one in passes:
        assert all(count > 0 for count in one.dropped.values())
        assert one.tried is None or one.tried == one.count + sum(one.dropped.values())
    if passes:
        candidates = sum(len(view.confidence) for view in segmentation.candidates)
        assert passes[0].count == candidates - sum(passes[0].dropped.values())
    if len(segmentation.leaves):
        assert len(segmentation.leaves) == passes[-1].count - sum(segmentation.dropped.values())


@pytest.fixture(scope="module")
def known():
    return known_foliage()


@pytest.fixture(scope="module")
def exact(known):
    return segment_dense(known.views)


@pytest.fixture(scope="module")
def noisy(known):
    return segment_dense(known.noisy_views)


@pytest.fixture(scope="module")
def few():
    return known_foliage(14, 3, (320, 240))


@pytest.fixture(scope="module")
def few_found(few):
    return segment_dense(few.noisy_views)


@pytest.mark.parametrize("depth", ["exact", "noisy"])
def test_well_visible_leaves_are_found_once_each(known, depth, request):
    segmentation = request.getfixturevalue(depth)
    views = known.views if depth == "exact" else known.noisy_views
    check_plain(segmentation, views)
    found = owners(known, segmentation.leaves)
    assert (known.visible > 0.8).sum() > 30
    assert recall(known, found, known.visible > 0.8) > 0.9
    assert recall(known, found, known.visible > 0.5) > 0.85
    assert (found.leaf >= 0).mean() > 0.95  # not wood, ground or wall
    assert len(set(found.leaf)) > 0.95 * len(found.leaf)


def test_points_are_of_one_leaf(known, noisy):
    purity = owners(known, noisy.leaves).purity
    assert np.median(purity) > 0.98  # points of free edges lie on the border of its pixels
    assert np.quantile(purity, 0.1) > 0.95
    assert purity.min() > 0.8


def test_points_are_of_one_leaf_where_depth_is_exact(known, exact):
    purity = owners(known, exact.leaves).purity
    assert np.quantile(purity, 0.1) > 0.85


def test_points_show_all_that_is_seen_of_a_leaf(known, noisy):
    """From end to end, since ends that are missed make leaves short."""
    found = owners(known, noisy.leaves)
    ratios = []
    for number, leaf in enumerate(found.leaf):
        if leaf < 0 or known.visible[leaf] < 0.9:
            continue
        part = slice(*noisy.leaves.offsets[number : number + 2])
        axis = known.truth.apex_m[leaf] - known.truth.base_m[leaf]
        ratios.append(np.ptp(noisy.leaves.points_m[part] @ axis) / (axis @ axis))
    assert len(ratios) > 20
    assert np.median(ratios) > 0.9
    assert np.quantile(ratios, 0.9) < 1.2


def test_the_surest_leaves_are_leaves(known, noisy):
    found = owners(known, noisy.leaves)
    sure = noisy.leaves.confidence >= np.median(noisy.leaves.confidence)
    assert (found.purity[sure] > 0.9).all()
    assert len(set(found.leaf[sure])) == sure.sum()


def test_one_view_is_enough_for_what_it_shows(known):
    view = known.noisy_views[0]
    segmentation = segment_dense([view])
    check_plain(segmentation, [view])
    found = owners(replace(known, views=[view], leaf_ids=known.leaf_ids[:1]), segmentation.leaves)
    visible_px = np.bincount(known.leaf_ids[0].ravel(), minlength=len(known.leaves) + 1)[1:]
    visible = (known.visible > 0.8) & (visible_px > 500)
    assert visible.sum() > 15
    assert recall(known, found, visible) > 0.75
    assert np.median(found.purity) > 0.97


def test_leaves_that_stand_in_front_of_a_wall_with_exact_depth():
    views = drawn((*LEAVES, WALL), noise_m=0.0)
    segmentation = segment_dense(views)
    check_plain(segmentation, views)
    leaves = segmentation.leaves
    centers = [leaves.points_m[a:b].mean(axis=0) for a, b in zip(leaves.offsets[:-1], leaves.offsets[1:], strict=True)]
    nearest = [min(np.linalg.norm(center - leaf.center) for center in centers) for leaf in LEAVES]
    assert len(leaves) == 3
    assert max(nearest) < 0.005


def test_the_same_again_for_any_number_of_threads(few, few_found):
    for threads in (1, 2):
        again = segment_dense(few.noisy_views, threads=threads)
        assert same_points(again.leaves, few_found.leaves)
        assert (again.dropped, again.passes) == (few_found.dropped, few_found.passes)
        for one, other in zip(again.candidates, few_found.candidates, strict=True):
            assert np.array_equal(one.labels, other.labels)
            assert np.array_equal(one.confidence, other.confidence)


@pytest.mark.parametrize("scale", [0.1, 10.0])
def test_scale_does_not_matter(few, few_found, scale):
    other = segment_dense(scaled(few.noisy_views, scale))
    assert len(few_found.leaves) == len(other.leaves) > 7
    for one, two in zip(few_found.candidates, other.candidates, strict=True):
        assert (one.labels == two.labels).mean() > 0.999
    here, there = owners(few, few_found.leaves).leaf, owners(few, unscaled(other.leaves, scale)).leaf
    # Leaves that are worth the same but for rounding may change places.
    order, its_order = np.argsort(here, kind="stable"), np.argsort(there, kind="stable")
    assert np.array_equal(here[order], there[its_order])
    # Depth that is rounded elsewhere tips a decision here and there.
    sizes, others = np.diff(few_found.leaves.offsets)[order], np.diff(other.leaves.offsets)[its_order]
    assert np.median(np.abs(others / sizes - 1)) < 0.01
    assert np.abs(others / sizes - 1).max() < 0.1
    change = np.abs(other.leaves.confidence[its_order] - few_found.leaves.confidence[order])
    assert np.median(change) < 0.02
    assert np.quantile(change, 0.8) < 0.07


def assert_nearly_the_same(one: Owners, other: Owners) -> None:
    """Rounding and the order of sums decide about leaves that are just kept or just not, no others."""
    both = len(set(one.leaf) & set(other.leaf))
    assert both >= 0.8 * max(len(one.leaf), len(other.leaf))


def unscaled(leaves: LeafPoints, scale: float) -> LeafPoints:
    return replace(leaves, points_m=leaves.points_m / scale)


def test_the_frame_of_the_world_does_not_matter(few, few_found):
    turn = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0], [0.48, 0.64, 0.6]])  # old from new
    shift = np.array([2.0, -1.0, 3.0])
    views = [
        replace(
            view,
            camera=replace(
                view.camera,
                cam_from_world=view.camera.cam_from_world @ np.vstack([np.column_stack([turn, shift]), [0, 0, 0, 1]]),
            ),
        )
        for view in few.noisy_views
    ]
    other = segment_dense(views).leaves
    back = replace(other, points_m=other.points_m @ turn.T + shift)
    assert_nearly_the_same(owners(few, few_found.leaves), owners(few, back))


def test_the_order_of_views_hardly_matters(few, few_found):
    other = segment_dense(few.noisy_views[::-1]).leaves
    back = replace(other, point_view=(2 - other.point_view).astype(np.int32))
    assert_nearly_the_same(owners(few, few_found.leaves), owners(few, back))


def test_a_view_without_depth_is_as_good_as_none(few, few_found):
    views = [few.noisy_views[0], blind(few.noisy_views[0]), *few.noisy_views[1:]]
    segmentation = segment_dense(views)
    check_plain(segmentation, views)
    assert not segmentation.candidates[1].labels.any()
    number = np.array([0, 2, 3], np.int32)
    expected = few_found.leaves
    expected = replace(expected, view=number[expected.view], point_view=number[expected.point_view])
    assert same_points(segmentation.leaves, expected)


def test_no_depth_and_no_views(few):
    views = [blind(view) for view in few.views]
    nothing = segment_dense(views)
    check_plain(nothing, views)
    assert len(nothing.leaves) == 0
    assert not any(len(candidates.confidence) for candidates in nothing.candidates)
    assert len(segment_dense([]).leaves) == 0


@pytest.mark.parametrize("noise_m", [0.0, 0.001])
def test_a_wall_has_no_leaves(noise_m):
    views = drawn([WALL], noise_m)
    segmentation = segment_dense(views)
    check_plain(segmentation, views)
    assert len(segmentation.leaves) == 0
    assert sum(sum(one.dropped.values()) for one in segmentation.passes) > 0


def test_every_view_as_flat_as_the_wall_before_it(few):
    """What all views contradict leaves no candidate for the later passes."""
    flat = [replace(view, depth_m=np.full_like(view.depth_m, np.median(view.depth_m))) for view in few.views]
    segmentation = segment_dense(flat)
    check_plain(segmentation, flat)
    assert len(segmentation.leaves) == 0


def test_depth_of_a_single_pixel_and_of_scattered_ones():
    cam = camera()
    one, some = (np.zeros((cam.height_px, cam.width_px), np.float32) for _ in range(2))
    one[90, 120] = 1.0
    some[::7, ::5] = 1.0
    for depth_m in (one, some):
        views = [View(name="few.png", camera=cam, srgb=np.zeros((*depth_m.shape, 3), np.uint8), depth_m=depth_m)] * 2
        segmentation = segment_dense(views)
        check_plain(segmentation, views)
        assert len(segmentation.leaves) == 0


def test_a_mask_limits_candidates(few):
    left = np.zeros_like(few.views[0].depth_m, bool)
    left[:, : left.shape[1] // 2] = True
    views = [replace(view, mask=left) for view in few.views]
    segmentation = segment_dense(views)
    check_plain(segmentation, views)
    assert not any(candidates.labels[~left].any() for candidates in segmentation.candidates)
    found = owners(few, segmentation.leaves)
    visible_px = np.mean([np.bincount(ids[left], minlength=15)[1:] for ids in few.leaf_ids], axis=0)
    whole = np.mean([np.bincount(ids.ravel(), minlength=15)[1:] for ids in few.leaf_ids], axis=0)
    inside = (few.visible > 0.8) & (visible_px > 0.95 * whole)
    assert recall(few, found, inside) > 0.7
    assert len(segment_dense([replace(view, mask=left & False) for view in views]).leaves) == 0


def test_a_mask_with_holes_in_depth(few):
    left = np.zeros_like(few.views[0].depth_m, bool)
    left[:, : left.shape[1] // 2] = True
    assert len(segment_dense([replace(view, mask=left) for view in few.noisy_views]).leaves) >= 3


def test_leaves_before_the_sky_which_has_no_depth():
    assert len(segment_dense(drawn(LEAVES)).leaves) == 3


def test_a_mask_of_the_plant_loses_no_leaves(few, few_found):
    views = [replace(view, mask=ids > 0) for view, ids in zip(few.noisy_views, few.leaf_ids, strict=True)]
    segmentation = segment_dense(views)
    check_plain(segmentation, views)
    assert len(segmentation.leaves) > 0.8 * len(few_found.leaves)
    assert (owners(few, segmentation.leaves).leaf >= 0).all()


def test_a_wider_plane_threshold_takes_as_many_leaves_and_progress_rises_to_the_end(few, few_found):
    calls: list[tuple[int, int]] = []
    settings = DenseSegmentationSettings(plane_threshold_m=0.004)
    segmentation = segment_dense(few.noisy_views, settings, lambda done, total: calls.append((done, total)))
    check_plain(segmentation, few.noisy_views)
    assert len(segmentation.leaves) > 0.8 * len(few_found.leaves)

    done, totals = zip(*calls, strict=True)
    assert list(done) == sorted(done)
    assert set(totals) == {done[-1]}


def test_settings_that_make_no_sense_are_refused():
    for wrong in (-1.0, 0.0, float("nan")):
        with pytest.raises(ValueError, match="plane_threshold_m"):
            DenseSegmentationSettings(plane_threshold_m=wrong)
    for name in ("piece_length", "twins", "shared", "reach"):
        for wrong in (-1.0, float("nan")):
            with pytest.raises(ValueError, match=name):
                DenseSegmentationSettings(**{name: wrong})
    for wrong in (-0.1, 1.1, float("nan")):
        with pytest.raises(ValueError, match="min_confidence must be from 0 to 1"):
            DenseSegmentationSettings(min_confidence=wrong)
    for name, value in {"min_quality": 1.5, "violation_weight": -1.0, "max_overlap": 0.0}.items():
        with pytest.raises(ValueError, match=name):
            PassSettings(**({"min_quality": 0.2, "violation_weight": 1.0, "max_overlap": 0.5} | {name: value}))


def row(*numbers: int) -> NDArray[np.int32]:
    return np.array([numbers], np.int32)


def test_claims_go_on_along_their_surface():
    labels = row(0, 0, 5, 5, 5, 5, 5, 0, 0, 0)
    patches = row(3, 3, 3, 3, 3, 3, 3, 3, 4, 0)
    assert complete_claims(labels, patches, 10).tolist() == [[5, 5, 5, 5, 5, 5, 5, 5, 0, 0]]


def test_claims_extend_no_farther_than_the_limit():
    labels = row(0, 0, 0, 5, 5, 5, 5, 5, 0, 0)
    patches = row(*[1] * 10)
    assert complete_claims(labels, patches, 2.2).tolist() == [[0, 5, 5, 5, 5, 5, 5, 5, 5, 5]]
    assert complete_claims(labels, patches, 0).tolist() == labels.tolist()


def test_the_nearest_claim_goes_on():
    labels = row(1, 1, 1, 1, 0, 0, 0, 0, 2, 2, 2, 2)
    assert complete_claims(labels, row(*[7] * 12), 5).tolist() == [[1] * 6 + [2] * 6]


def test_nothing_claimed_stays_so():
    labels = np.zeros((4, 5), np.int32)
    assert not complete_claims(labels, np.ones((4, 5), np.int32), 3).any()


@given(
    labels=hnp.arrays(np.int32, (6, 7), elements=st.sampled_from([0, 0, 0, 1, 2, 3])),
    patches=hnp.arrays(np.int32, (6, 7), elements=st.sampled_from([0, 1, 1, 1, 2])),
    reach_px=st.floats(0, 6),
)
def test_claims_go_on_only_from_a_claim_of_the_same_patch(labels, patches, reach_px):
    before = labels.copy()
    completed = complete_claims(labels, patches, reach_px)
    assert np.array_equal(labels, before)
    assert completed.dtype == np.int32
    assert np.array_equal(completed[labels > 0], labels[labels > 0])
    for i, j in zip(*np.nonzero(completed != labels), strict=True):
        sources = np.argwhere((labels == completed[i, j]) & (patches == patches[i, j]))
        assert patches[i, j] > 0
        assert np.linalg.norm(sources - (i, j), axis=1).min() <= 1.05 * reach_px + 1e-6  # distances to a few per cent
