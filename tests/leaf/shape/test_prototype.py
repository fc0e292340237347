"""How far the leaf that an instancer repeats is from the leaves' surfaces, and how it is divided for that."""

import numpy as np
import pytest
from usdfoliage.leaf.shape.deviation import measure_deviation
from usdfoliage.leaf.shape.mesh import PrototypeSettings
from usdfoliage.leaf.shape.prototype import PrototypeChoice, choose_prototype, place_vertices
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places
from usdfoliage.leaf.shape.topology import VertexPlaces, leaf_topology
from usdfoliage.leaf.shape.variation import default_leaf, vary_leaves

SHORT = PrototypeChoice(sample=30)  # so that the search is quick
EVEN = PrototypeSettings(across=4, along=6, silhouette=10, even=True)


def distances(points, corners):
    """(P,) of points (P, 3) to the nearest of triangles (T, 3, 3)."""
    a, b, c = np.moveaxis(corners, 1, 0)
    normal = np.cross(b - a, c - a)
    area = (normal**2).sum(axis=1)
    to = points[:, None] - a
    second = (np.cross(to, c - a) * normal).sum(axis=2) / area
    third = (np.cross(b - a, to) * normal).sum(axis=2) / area
    inside = (second >= 0) & (third >= 0) & (second + third <= 1)
    found = np.where(inside, np.abs((to * normal).sum(axis=2)) / np.sqrt(area), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        along = end - start
        share = np.clip(((points[:, None] - start) * along).sum(axis=2) / (along**2).sum(axis=1), 0, 1)
        found = np.minimum(found, np.linalg.norm(points[:, None] - start - share[..., None] * along, axis=2))
    return found.min(axis=1)


def test_distances_to_a_triangle():
    corners = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    points = np.array([[0.2, 0.2, 0.3], [-1, 0.5, 0], [1, 1, 0], [-3, -4, 0]])
    np.testing.assert_allclose(distances(points, corners), [0.3, 1, np.sqrt(0.5), 5])


def test_the_deviation_is_the_distance_to_the_nearest_triangle_or_a_little_more():
    leaves = vary_leaves(20, np.random.default_rng(3))
    places = grid_places(np.linspace(-1, 1, 25), np.linspace(0, 1, 81))
    for form in (EVEN, PrototypeSettings(across=6, along=5, silhouette=5)):
        topology = form.topology()
        drawn, surface = evaluate_points(leaves, topology.uv), evaluate_points(leaves, places)
        nearest = [distances(surface[n], drawn[n][topology.triangles]).max() for n in range(len(leaves))]
        ratio = measure_deviation(leaves, topology) / nearest
        assert ratio.min() > 0.9
        assert ratio.max() < 1.3


def test_a_flat_leaf_deviates_by_the_sagitta_of_its_chords():
    flat = np.array(
        [[0, 1 / 3, 0], [0, 2 / 3, 0], [0.2, 0.2, 0], [0.5, 0.3, 0], [0.8, 0.2, 0], [0, 0, 0], [0, 0, 0]], np.float64
    )
    coarse, fine = (measure_deviation(flat[None], leaf_topology(4, along, along, even=True))[0] for along in (8, 16))
    assert coarse / fine == pytest.approx(4, rel=0.25)  # with the square of a chord's length
    v = np.linspace(0, 1 / 8, 101)
    curve = evaluate_points(flat[None], np.column_stack([np.ones(101), v]))[0]
    chord = (curve[-1] - curve[0]) / np.linalg.norm(curve[-1] - curve[0])
    sagitta = np.linalg.norm(curve - curve[0] - ((curve - curve[0]) @ chord)[:, None] * chord, axis=1).max()
    assert coarse == pytest.approx(sagitta, rel=0.1)  # a silhouette turns most at the base


def test_triangles_are_those_of_every_face_from_its_first_corner():
    topology = leaf_topology(4, 5, 10, even=True)
    assert len(topology.triangles) == PrototypeSettings(across=4, along=5, silhouette=10).triangles == 42
    a, b, c = np.moveaxis(topology.uv[topology.triangles], 1, 0)
    areas = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    # Base and apex are one place for all u: triangles there are narrower, and none is turned over.
    assert areas.min() > -1e-12
    assert areas.sum() == pytest.approx(2 - 2 / 10)


@pytest.mark.parametrize(("count", "max_triangles"), [(3000, 404), (3001, 48), (100_000, 48)])
def test_natural_leaves_that_are_many_have_few_triangles_within_half_a_percent(count, max_triangles):
    some = vary_leaves(400, np.random.default_rng(1))
    chosen = choose_prototype(np.resize(some, (count, 7, 3)))
    assert chosen.triangles <= max_triangles
    assert np.quantile(measure_deviation(some, chosen.topology()), 0.88) < 0.005  # nine in ten of a sample are


def test_curved_halves_get_columns_as_far_as_the_number_of_leaves_allows():
    cupped = vary_leaves(60, np.random.default_rng(2))
    cupped[:, 5:, :] += 0.06  # inner and outer points: every half is an arch across
    found = {}
    for count in (1000, 8000, 100_000):
        chosen = choose_prototype(np.resize(cupped, (count, 7, 3)), SHORT)
        assert chosen.triangles <= max(2_000_000 // count, 48)
        found[count] = chosen, np.quantile(measure_deviation(cupped, chosen.topology()), 0.9)
    assert found[1000][1] < 0.0055
    assert found[8000][1] < 0.0055  # of the sample within 0.005
    assert found[8000][0].triangles > 48
    assert found[100_000][1] > 0.005
    # None of the forms that so many may have is nearer.
    for form in (PrototypeSettings(across=4, along=5, silhouette=10, even=True), EVEN):
        assert found[100_000][1] < np.quantile(measure_deviation(cupped, form.topology()), 0.9)


def test_moved_vertices_come_nearer_and_stay_in_order():
    leaves = vary_leaves(30, np.random.default_rng(4))
    placed = place_vertices(leaves, EVEN)
    assert placed == place_vertices(leaves, EVEN)  # every time
    assert placed.places is not None
    before, after = (measure_deviation(leaves, form.topology()) for form in (EVEN, placed))
    assert (after**4).mean() < 0.9 * (before**4).mean()
    rows = placed.topology().uv[2:17].reshape(5, 3, 2)
    assert (np.diff(rows[:, 0, 1]) > 0).all()
    assert (np.diff(rows[0, :, 0]) > 0).all()
    np.testing.assert_allclose(rows[..., 0], -rows[:, ::-1, 0])  # the axis stays an edge


def test_no_leaves_have_the_first_form_and_a_choice_may_ask_for_more():
    assert choose_prototype(np.zeros((0, 7, 3))) == PrototypeSettings()
    leaf = default_leaf()[None]
    near = choose_prototype(leaf, PrototypeChoice(few=0, within=0.001))
    assert measure_deviation(leaf, near.topology())[0] < 0.001
    assert near.triangles > choose_prototype(leaf, PrototypeChoice(few=0)).triangles


@pytest.mark.parametrize("columns", [(0.5, 0.4), (1.0,), (0.0,), (0.3, 0.6)])
def test_impossible_places_are_refused(columns):
    rows, silhouette = tuple(np.arange(1, 6) / 6), tuple(np.arange(1, 10) / 10)
    with pytest.raises(ValueError, match="must"):
        PrototypeSettings(
            across=4,
            along=6,
            silhouette=10,
            places=VertexPlaces(columns=columns, rows=rows, silhouette=silhouette),
        )
