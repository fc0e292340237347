"""Directions of the points around each point, and links across branches."""

import numpy as np
import pytest
from usdfoliage.branch.tracing.cloud_graph import link_points
from usdfoliage.branch.tracing.local_directions import local_directions
from usdfoliage.branch.tracing.sections import find_paths, measure_across


def test_points_of_a_twig_are_in_line_and_those_of_a_wall_are_not():
    rng = np.random.default_rng(0)
    twig = np.outer(np.arange(200) * 0.01, [0.6, 0.8, 0]) + rng.normal(0, 1e-4, (200, 3))
    found = local_directions(twig)
    assert np.abs(found.direction @ [0.6, 0.8, 0]).min() > 0.999
    assert found.in_line.min() > 0.99
    wall = np.stack(np.meshgrid(np.arange(20), np.arange(20), [0]), axis=-1).reshape(-1, 3) * 0.01
    inner = (wall > 0.045).sum(axis=1) + (wall < 0.145).sum(axis=1) == 5
    assert local_directions(wall).in_line[inner].max() < 0.5


def test_two_points_or_several_at_one_place_have_no_line_that_is_not_a_number():
    for points_m in (np.zeros((2, 3)), np.zeros((30, 3)), np.array([[0.0, 0, 0], [0, 1, 0]])):
        found = local_directions(points_m)
        assert np.isfinite(found.direction).all()
        assert ((found.in_line >= 0) & (found.in_line <= 1)).all()


def crossing_twigs():
    """One upwards, one level that touches it at half its height and leads back to the root's side by a short cut."""
    along = np.arange(0, 101) * 0.01
    up = np.column_stack([0 * along, along, 0 * along])
    level = np.column_stack([along - 0.5, np.full(101, 0.5), np.full(101, 0.012)])
    return np.concatenate([up, level])


def test_links_between_twigs_that_touch_lead_across_both():
    points_m = crossing_twigs()
    graph = link_points(points_m).bridged_m
    across = measure_across(points_m, graph)
    links = graph.tocoo()
    between = (links.row < 101) != (links.col < 101)
    far = np.abs(points_m[links.row] - [0, 0.5, 0]).max(axis=1) > 0.2
    assert across[far & ~between].max() < 1e-6
    assert between.any()
    assert across[between].mean() > 0.25


def test_a_link_across_costs_more():
    points_m = np.array([[0.0, 0, 0], [0.005, 0.01, 0], [0, 0.02, 0], [-0.006, 0.01, 0]])
    graph = link_points(points_m).bridged_m
    links = graph.tocoo()
    plain = find_paths(graph, np.array([0]), np.array([0]), 2.0)
    assert plain.before[2] == 1
    dear = np.where((links.row == 1) | (links.col == 1), 5.0, 0.0)
    assert find_paths(graph, np.array([0]), np.array([0]), 2.0, across=dear).before[2] == 3
    assert find_paths(graph, np.array([0]), np.array([0]), 2.0, across=7.0).before.tolist() == plain.before.tolist()


def test_the_direction_of_a_stem_with_points_all_round_is_its_own():
    rng = np.random.default_rng(1)
    turn, along = rng.uniform(0, 2 * np.pi, 3000), rng.uniform(0, 1, 3000)
    stem = np.column_stack([0.002 * np.cos(turn), along, 0.002 * np.sin(turn)])
    assert np.median(np.abs(local_directions(stem).direction[:, 1])) == pytest.approx(1, abs=0.3)
