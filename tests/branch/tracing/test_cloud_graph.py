"""Graphs of clouds: nearest points linked, and what is in pieces bridged where the gap is narrowest."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial import Delaunay, cKDTree
from scipy.spatial.distance import cdist
from usdfoliage.branch.tracing.cloud_graph import CloudGraphSettings, link_points


def lump(middle_m, count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-0.5, 0.5, (count, 3)) + middle_m


def crossing(lengths_m, group: np.ndarray) -> list[tuple[int, int]]:
    """Links between groups, each once."""
    links = lengths_m.tocoo()
    over = (group[links.row] != group[links.col]) & (links.row < links.col)
    return list(zip(links.row[over].tolist(), links.col[over].tolist(), strict=True))


@pytest.mark.parametrize("count", [20, 400])  # 400 points see none of the other lump's among their nearest
def test_two_lumps_are_joined_by_their_shortest_link(count):
    points_m = np.concatenate([lump([0, 0, 0], count, 0), lump([3, 1, 0], count, 1)])
    group = np.repeat([0, 1], count)
    graph = link_points(points_m, CloudGraphSettings(neighbors=6))
    assert graph.pieces == 2
    away_m = cdist(points_m[:count], points_m[count:])
    start, end = np.unravel_index(np.argmin(away_m), away_m.shape)
    assert crossing(graph.lengths_m, group) == [(start, count + end)]
    assert graph.lengths_m[start, count + end] == pytest.approx(away_m.min())


@examples(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(2, 200), neighbors=st.integers(1, 5))
def test_the_graph_is_one_piece_and_bridges_are_as_short_as_they_can_be(seed, count, neighbors):
    points_m = np.random.default_rng(seed).normal(size=(count, 3)) ** 3
    graph = link_points(points_m, CloudGraphSettings(neighbors=neighbors))
    assert connected_components(graph.lengths_m, directed=False)[0] == 1
    assert abs(graph.lengths_m - graph.lengths_m.T).max() == 0
    links = graph.lengths_m.tocoo()
    true_m = np.linalg.norm(points_m[links.row] - points_m[links.col], axis=1)
    np.testing.assert_allclose(links.data, true_m, rtol=1e-12)

    near = cKDTree(points_m).query(points_m, k=min(neighbors, count - 1) + 1)[1]
    alone = np.zeros((count, count), bool)
    alone[np.repeat(np.arange(count), near.shape[1]), near.ravel()] = True
    assert (graph.lengths_m.toarray() > 0)[alone & ~np.eye(count, dtype=bool)].all()
    pieces, piece_of = connected_components(alone, directed=False)
    assert graph.pieces == pieces
    gaps_m = np.zeros((pieces, pieces))
    for one in range(pieces):
        for other in range(pieces):
            gaps_m[one, other] = cdist(points_m[piece_of == one], points_m[piece_of == other]).min()
    bridges_m = [graph.lengths_m[start, end] for start, end in crossing(graph.lengths_m, piece_of)]
    assert sum(bridges_m) == pytest.approx(minimum_spanning_tree(gaps_m).sum())


def shortest_bridges_m(points_m: np.ndarray, group: np.ndarray) -> float:
    """Length of the bridges between groups, of edges of the Delaunay tetrahedra: no others can be the shortest."""
    corners = Delaunay(points_m).simplices
    edges = np.concatenate([corners[:, pair] for pair in ([0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3])])
    edges = edges[group[edges[:, 0]] != group[edges[:, 1]]]
    length_m = np.linalg.norm(points_m[edges[:, 0]] - points_m[edges[:, 1]], axis=1)
    between = np.sort(group[edges], axis=1)
    order = np.lexsort((length_m, between[:, 1], between[:, 0]))
    between, first = np.unique(between[order], axis=0, return_index=True)
    groups = int(group.max()) + 1
    return minimum_spanning_tree(csr_array((length_m[order][first], between.T), shape=(groups, groups))).sum()


@pytest.mark.parametrize(("clumps", "points"), [(1500, 10), (20, 500)])
def test_each_of_many_clumps_is_bridged_once_by_the_shortest_link(clumps, points):
    rng = np.random.default_rng(5)
    middle_m = rng.uniform(0, 10, (clumps, 1, 3))
    points_m = (middle_m + rng.normal(0, 0.005, (clumps, points, 3))).reshape(-1, 3)
    graph = link_points(points_m, CloudGraphSettings(neighbors=9))
    near = cKDTree(points_m).query(points_m, k=10)[1]
    linked = csr_array((np.ones(near.size), (np.repeat(np.arange(len(points_m)), 10), near.ravel())))
    pieces, piece_of = connected_components(linked, directed=False)
    assert graph.pieces == pieces > 0.9 * clumps
    assert connected_components(graph.lengths_m, directed=False)[0] == 1
    bridges = np.array(crossing(graph.lengths_m, piece_of))
    assert len(bridges) == pieces - 1
    bridges_m = np.linalg.norm(points_m[bridges[:, 0]] - points_m[bridges[:, 1]], axis=1)
    assert bridges_m.sum() == pytest.approx(shortest_bridges_m(points_m, piece_of))


def test_bridges_of_one_length_close_no_circle():
    middle_m = np.stack(np.meshgrid(*[np.arange(8.0)] * 3), axis=-1).reshape(-1, 1, 3)
    points_m = np.add(middle_m, [[0, 0, 0], [0, 0.5, 0]]).reshape(-1, 3)
    graph = link_points(points_m, CloudGraphSettings(neighbors=1))
    bridges = np.array(crossing(graph.lengths_m, np.arange(len(points_m))))
    assert connected_components(graph.lengths_m, directed=False)[0] == 1
    assert len(bridges) == len(points_m) - 1
    assert graph.lengths_m.sum() / 2 == pytest.approx(512 * 0.5 + 8 * 8 * 7 * 0.5 + 63)


def test_points_on_each_other_are_linked():
    graph = link_points(np.repeat([[0.0, 0, 0], [0, 1, 0]], 30, axis=0), CloudGraphSettings(neighbors=4))
    assert connected_components(graph.lengths_m, directed=False)[0] == 1
    assert (graph.lengths_m.data > 0).all()
    assert graph.lengths_m.data.max() == pytest.approx(1)


def test_two_points_are_one_link():
    graph = link_points(np.array([[0.0, 0, 0], [0, 2, 0]]))
    assert graph.lengths_m.toarray().tolist() == [[0, 2], [2, 0]]
    assert graph.pieces == 1


@pytest.mark.parametrize("count", [0, 1])
def test_fewer_than_two_points_are_refused(count):
    with pytest.raises(ValueError, match=f"takes two points, not {count}"):
        link_points(np.zeros((count, 3)))


def test_no_neighbors_are_refused():
    with pytest.raises(ValueError, match="neighbors must be at least 1"):
        CloudGraphSettings(neighbors=0)
