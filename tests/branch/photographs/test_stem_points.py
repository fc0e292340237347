"""Stems of drawn photographs: helices and straight stems come back, leaves give none."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from usdfoliage.branch.photographs.distances import DistanceSettings, find_distances
from usdfoliage.branch.photographs.joined import JoinedStems
from usdfoliage.branch.photographs.lines import find_lines
from usdfoliage.branch.photographs.no_stems import NoStems
from usdfoliage.branch.photographs.reconstruct import FoundLeafPlaces, find_stem_points, reconstruct_stems
from usdfoliage.branch.photographs.seen_lines import place_lines, ranges_in_box
from usdfoliage.branch.photographs.stem_points import MergeSettings

from tests.support.drawn_stems import camera_at, draw_view, ring_of_cameras

BOX_M = np.array([[-0.12, 0.0, -0.12], [0.12, 0.32, 0.12]])


def helix(radius_m=0.05, height_m=0.26, turns=0.7):
    turn = np.linspace(0, 2 * np.pi * turns, 160)
    return np.stack(
        [radius_m * np.cos(turn), 0.02 + np.linspace(0, height_m, len(turn)), radius_m * np.sin(turn)], axis=1
    )


def test_a_helix_comes_back_within_a_fraction_of_its_radius():
    axis_m, radius_m = helix(), 0.003
    views = [draw_view(camera, [(axis_m, radius_m)]) for camera in ring_of_cameras(6)]
    stems = find_stem_points(views, BOX_M)
    away_m, _ = cKDTree(axis_m).query(stems.points_m)
    assert len(stems) > 60
    assert np.quantile(away_m, 0.9) < 0.5 * radius_m
    assert np.median(stems.radius_m) == pytest.approx(radius_m, rel=0.15)
    missed_m, _ = cKDTree(stems.points_m).query(axis_m)
    assert (missed_m < 0.006).mean() > 0.9
    assert (stems.odds > 0).mean() > 0.9


def test_a_line_along_the_epipolar_lines_of_a_pair_is_resolved_by_the_third_photograph():
    # Two cameras side by side see a level stem end to end; only one above them shows how far it is.
    axis_m = np.stack([np.linspace(-0.09, 0.09, 80), np.full(80, 0.15), np.zeros(80)], axis=1)
    pair = [camera_at((x, 0.15, 0.6), (0, 0.15, 0)) for x in (-0.15, 0.15)]
    above = camera_at((0.0, 0.45, 0.5), (0, 0.15, 0))
    seen = [place_lines(find_lines(draw_view(camera, [(axis_m, 0.003)]).srgb), camera) for camera in (*pair, above)]
    settings = DistanceSettings(min_votes=0.3)
    alone = find_distances(seen[0], seen[1:2], BOX_M, settings)
    assert len(alone) < 0.1 * len(seen[0])
    both = find_distances(seen[0], seen[1:], BOX_M, settings)
    assert len(both) > 0.5 * len(seen[0])
    away_m, _ = cKDTree(axis_m).query(both.points_m)
    assert np.median(away_m) < 0.003


def random_leaves(count: int, seed: int) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    turn = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    leaves = []
    for _ in range(count):
        frame, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        middle_m = np.array([0, 0.15, 0]) + rng.uniform(-0.07, 0.07, 3)
        leaves.append(middle_m + 0.035 * np.outer(np.cos(turn), frame[0]) + 0.02 * np.outer(np.sin(turn), frame[1]))
    return leaves


def test_a_leafy_picture_without_stems_gives_no_stems():
    leaves = random_leaves(25, 3)
    views = [draw_view(camera, leaves=leaves) for camera in ring_of_cameras(8)]
    assert reconstruct_stems(views, BOX_M, FoundLeafPlaces.none()) is NoStems.NOT_JOINED
    # Nor do the leaves that were found among them.
    found = FoundLeafPlaces(
        bases_m=np.array([leaf[0] for leaf in leaves]),
        apices_m=np.array([leaf[20] for leaf in leaves]),
        certainty=np.full(len(leaves), 0.5),
        blades_m=np.concatenate(leaves),
    )
    assert reconstruct_stems(views, BOX_M, found) is NoStems.NOT_JOINED


def test_a_stem_among_leaves_is_found_from_the_soil_up():
    axis_m = np.stack([np.linspace(0.01, -0.02, 90), np.linspace(0.0, 0.28, 90), np.linspace(0, 0.015, 90)], axis=1)
    views = [
        draw_view(camera, [(axis_m, 0.003)], random_leaves(9, 5), with_depth=True) for camera in ring_of_cameras(10)
    ]
    joined = reconstruct_stems(views, BOX_M, FoundLeafPlaces.none())
    assert isinstance(joined, JoinedStems)
    skeleton = joined.skeleton
    longest = int(skeleton.lengths_m.argmax())
    stem_m = skeleton.points_m[skeleton.branch(longest)]
    assert stem_m[0, 1] == pytest.approx(0.0, abs=1e-6)  # on the soil
    assert stem_m[-1, 1] > 0.24
    assert cKDTree(axis_m).query(stem_m)[0].max() < 0.01
    assert skeleton.lengths_m[skeleton.order == 0].sum() > 0.6 * skeleton.lengths_m.sum()


def test_photographs_of_nothing_have_no_lines():
    views = [draw_view(camera) for camera in ring_of_cameras(4)]
    assert reconstruct_stems(views, BOX_M, FoundLeafPlaces.none()) is NoStems.NO_LINES
    assert reconstruct_stems(views[:1], BOX_M, FoundLeafPlaces.none()) is NoStems.FEW_PHOTOGRAPHS


def test_without_photographs_there_are_no_stems():
    assert reconstruct_stems([], BOX_M, FoundLeafPlaces.none()) is NoStems.FEW_PHOTOGRAPHS
    with pytest.raises(ValueError, match="one view or more"):
        find_stem_points([], BOX_M)


@pytest.mark.parametrize("value", [-0.1, 2.1, float("nan")])
def test_sides_that_cannot_be(value):
    with pytest.raises(ValueError, match="max_beside must be from 0 to 2"):
        MergeSettings(max_beside=value)


def test_rays_that_miss_the_box_have_no_range():
    camera = camera_at((0.0, 0.15, 0.6), (0, 0.15, 0))
    view = draw_view(camera, [(helix(), 0.003)])
    seen = place_lines(find_lines(view.srgb), camera)
    near_m, far_m = ranges_in_box(seen, BOX_M)
    assert (near_m < far_m).all()
    assert near_m.min() > 0.4
    assert far_m.max() < 0.8
    beside_m = BOX_M + np.array([5.0, 0, 0])
    assert not ranges_in_box(seen, beside_m)[1].any()
    assert not len(find_distances(seen, [seen], beside_m))
