"""Clusters of leaves that fill a crown: inside it, from the first few on, each turned outwards."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from usdfoliage.crown.leafy_crown import (
    LeafyCrownSettings,
    build_leaf_clusters,
    build_leafy_crown,
    spread_in_ball,
    spread_on_ball,
)
from usdfoliage.crown.model import CrownModel
from usdfoliage.geometry.cubemap import face_directions, sample_cubemap

CENTER_M = np.array([0.3, 4.0, -0.2])


def crown(seed: int = 1) -> CrownModel:
    direction = face_directions(24)
    wave = np.random.default_rng(seed).normal(0, 2.5, (5, 3))
    radius_m = 1.8 + 0.1 * np.cos(direction @ wave.T).sum(axis=-1)
    color = np.broadcast_to([0.1, 0.2, 0.05], (6, 24, 24, 3))
    return CrownModel(radius_m=radius_m, color=color, center_m=CENTER_M, relief_weight=0.1, asset_from_photo=np.eye(4))


def turned_z(orientation: np.ndarray) -> np.ndarray:
    """(N, 3) where quaternions turn +Z."""
    w, x, y, z = orientation.T
    return np.column_stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])


@given(st.integers(0, 200))
def test_clusters_lie_in_the_crown_and_look_outwards(seed):
    model = crown(seed)
    leafy = build_leafy_crown(model, LeafyCrownSettings(seed=seed, clusters=120))
    out_m = leafy.place_m - CENTER_M
    away_m = np.linalg.norm(out_m, axis=1)
    reach_m = sample_cubemap(model.radius_m, out_m / away_m[:, None])
    assert (away_m < reach_m).all()
    np.testing.assert_allclose(turned_z(leafy.orientation), out_m / away_m[:, None], atol=1e-9)
    assert (leafy.radius_m > 0).all()
    assert (np.diff(leafy.rank) > 0).all()
    assert leafy.rank[0] == 0
    assert leafy.rank[-1] < 1


def test_every_prefix_covers_the_crown():
    model = crown()
    leafy = build_leafy_crown(model)
    direction = face_directions(24).reshape(-1, 3)
    surface_m = CENTER_M + model.radius_m.reshape(-1, 1) * direction
    for count in (24, 64, 160, 320):
        away_m = cKDTree(leafy.place_m[:count]).query(surface_m)[0]
        spacing_m = 1.8 * (4 * np.pi / 3 / count) ** (1 / 3)
        assert np.percentile(away_m, 95) < 1.35 * spacing_m


def test_a_thin_part_has_small_clusters_to_its_end_and_none_beside_it():
    direction = face_directions(48)
    axis = np.array([0.0, 0.0, 1.0])
    spike = np.arccos(np.clip(direction @ axis, -1, 1)) < 0.08  # .14 m thick where it begins, .29 m at its end
    model = replace(crown(), radius_m=np.where(spike, 3.6, 1.8), color=np.full((6, 48, 48, 3), 0.2))
    leafy = build_leafy_crown(model)
    out_m = leafy.place_m - CENTER_M
    on_spike = out_m[:, 2] > 2.2
    assert on_spike.sum() >= 4
    assert leafy.radius_m[on_spike].max() <= 0.75 * leafy.radius_m.max()
    assert (np.linalg.norm(out_m[on_spike, :2], axis=1) + leafy.radius_m[on_spike] < 1.0).all()
    assert out_m[:, 2].max() > 3.1
    body = out_m[:, 2] < 1.2
    assert np.mean(leafy.radius_m[body] == leafy.radius_m.max()) > 0.9


def test_directions_are_even_over_the_ball():
    directions = spread_on_ball(24)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
    np.testing.assert_allclose(directions.mean(axis=0), 0, atol=0.03)
    assert cKDTree(directions).query(directions, k=2)[0][:, 1].min() > 0.4


def test_the_deepest_and_lowest_are_darker_and_the_mean_is_the_crowns():
    leafy = build_leafy_crown(crown())
    shade = leafy.color[:, 1] / 0.2
    assert 0.6 < shade.min() < 0.75
    assert shade.max() <= 1
    np.testing.assert_allclose(leafy.color / shade[:, None], np.broadcast_to([0.1, 0.2, 0.05], leafy.color.shape))
    assert shade[leafy.place_m[:, 1] > 5].mean() > shade[leafy.place_m[:, 1] < 3].mean() + 0.05


def test_leaves_have_the_colors_of_the_crown_where_they_are():
    direction = face_directions(24)
    color = np.where(direction[..., :1] > 0, [0.4, 0.05, 0.05], [0.05, 0.05, 0.4])  # red on the right, blue on the left
    leafy = build_leafy_crown(replace(crown(), color=color), LeafyCrownSettings(clusters=80))
    assert leafy.leaf_color.shape == (80, 36, 3)
    side_m = leafy.place_m[:, 0] - CENTER_M[0]
    red = leafy.leaf_color[..., 0] / leafy.leaf_color[..., [0, 2]].sum(axis=-1)
    assert red[side_m > 0.6].mean() > 0.85
    assert red[side_m < -0.6].mean() < 0.15
    middle = np.abs(side_m) < 0.15  # one cluster has leaves of both
    assert np.ptp(red[middle], axis=1).mean() > 0.4


def test_leaves_are_as_bright_as_the_crown_and_darker_below_and_inside():
    leafy = build_leafy_crown(crown())
    shade = leafy.leaf_color[..., 1] / 0.2
    assert 0.7 < shade.mean() < 1
    high = leafy.place_m[:, 1] > CENTER_M[1]
    deep = np.linalg.norm(leafy.place_m - CENTER_M, axis=1) < 0.7
    assert shade[high].mean() > shade[~high].mean() + 0.05
    assert shade[deep].mean() < shade[~deep].mean()


def test_leaves_of_a_cluster_are_quads_with_a_middle_and_a_normal():
    cluster = build_leafy_crown(crown(), LeafyCrownSettings(leaves=9)).forms[0]
    corners = cluster.points.reshape(-1, 4, 3)
    np.testing.assert_allclose(corners.mean(axis=1), cluster.middle[::4], atol=1e-12)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    np.testing.assert_allclose(np.abs((normal * cluster.normals[::4]).sum(axis=1)), 1)
    size = np.linalg.norm(cluster.points - cluster.middle, axis=1)
    np.testing.assert_allclose(size, np.linalg.norm(cluster.corner, axis=1))
    assert (cluster.normals[:, 2] > 0).all()


@pytest.mark.parametrize(("width", "cover"), [(0.62, 0.667), (0.28, 0.65), (1.15, 0.77), (0.1, 0.5), (0.02, 0.7)])
def test_leaves_of_any_form_cover_the_same_area_with_no_leaf_far_out(width, cover):
    plain, other = LeafyCrownSettings(), LeafyCrownSettings(leaf_width=width, leaf_cover=cover)
    cluster = build_leaf_clusters(other)[0]
    corner = cluster.corner.reshape(-1, 4, 2)
    np.testing.assert_allclose(np.abs(corner[..., 0] / corner[..., 1]), width)
    area = other.leaf_count * width * cover * other.half_length**2
    same = plain.leaf_count * plain.leaf_width * plain.leaf_cover * plain.half_length**2
    if width > 0.05:  # a needle is as long as a leaf may be, and there are no more of them
        assert area == pytest.approx(same, rel=0.02)
    assert cluster.reach < build_leaf_clusters(plain)[0].reach + 0.45
    assert len(cluster.points) == 4 * other.leaf_count <= 16 * plain.leaf_count


def test_clusters_alone_are_of_the_seed_and_as_many_as_asked_for():
    one, again = (build_leaf_clusters(LeafyCrownSettings(forms=5, seed=3)) for _ in range(2))
    assert len(one) == 5
    for each, other in zip(one, again, strict=True):
        np.testing.assert_array_equal(each.points, other.points)


def test_places_are_in_the_ball_and_of_the_seed():
    one, again = (spread_in_ball(50, np.random.default_rng(4)) for _ in range(2))
    np.testing.assert_array_equal(one, again)
    assert np.linalg.norm(one, axis=1).max() <= 1
    apart = cKDTree(one).query(one, k=2)[0][:, 1]
    assert apart.min() > 0.6 * (4 * np.pi / 3 / 50) ** (1 / 3)


@pytest.mark.parametrize(
    "wrong", [{"clusters": 2}, {"leaves": 0}, {"forms": 0}, {"leaf_width": float("nan")}, {"leaf_cover": 0.0}]
)
def test_settings_that_cannot_be_are_refused(wrong):
    with pytest.raises(ValueError, match="must be"):
        LeafyCrownSettings(**wrong)
