import numpy as np
import pytest
from scipy.spatial.distance import cdist
from usdfoliage.leaf.segmentation.paper.affinity import AffinitySettings, join_superpixels, measure_affinity
from usdfoliage.leaf.segmentation.paper.planes import fit_planes

FOOTPRINT = 0.001
DELTA = 0.018


def grid(height: int = 20, width: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Points a footprint apart at z 1, and two superpixels side by side."""
    rows, columns = np.mgrid[:height, :width].astype(np.float64)
    points = np.dstack([(columns - width / 2) * FOOTPRINT, (rows - height / 2) * FOOTPRINT, np.ones_like(rows)])
    labels = (columns >= width / 2).astype(np.int32)
    return points, labels


def affinity_of(points, labels, **kwargs):
    planes = fit_planes(points, labels, np.zeros(3), DELTA, rng=np.random.default_rng(0))
    return measure_affinity(points, labels, planes, DELTA, **kwargs), planes


def test_coplanar_neighbors_join():
    graph, planes = affinity_of(*grid())
    assert graph.edges.tolist() == [[0, 1]]
    assert graph.affinity[0] == pytest.approx(np.exp(-((FOOTPRINT / DELTA) ** 2) / (2 * 0.2**2)), rel=1e-6)
    assert join_superpixels(graph, planes.valid).tolist() == [0, 0]


@pytest.mark.parametrize(("angle_deg", "joined"), [(10, True), (25, True), (30, False), (60, False)])
def test_planes_that_meet_at_an_angle(angle_deg, joined):
    points, labels = grid()
    angle = np.radians(angle_deg)
    beyond = np.maximum(points[..., 0], 0)
    points[..., 0] = np.minimum(points[..., 0], 0) + beyond * np.cos(angle)
    points[..., 2] += beyond * np.sin(angle)
    graph, planes = affinity_of(points, labels)
    d_n, d_p = 1 - np.cos(angle), FOOTPRINT / DELTA
    assert graph.affinity[0] == pytest.approx(np.exp(-(d_n**2 + d_p**2) / 0.08), rel=1e-3)
    assert (graph.affinity[0] >= 0.85) == joined
    assert (join_superpixels(graph, planes.valid).max() == 0) == joined


def test_a_step_parts_parallel_planes():
    points, labels = grid()
    points[labels == 1] += (0, 0, 0.01)
    graph, planes = affinity_of(points, labels)
    one, other = points[labels == 0], points[labels == 1]
    d_p = cdist(one, other).min() / DELTA
    assert graph.affinity[0] == pytest.approx(np.exp(-(d_p**2) / 0.08), rel=1e-6)
    assert join_superpixels(graph, planes.valid).tolist() == [0, 1]


def test_distances_above_the_threshold_are_exact():
    """Against all pairs of points, on bumpy ground."""
    rng = np.random.default_rng(4)
    rows, columns = np.mgrid[:40, :60]
    points = np.dstack([columns * FOOTPRINT, rows * FOOTPRINT, 1 + 0.002 * rng.random((40, 60))])
    labels = (rows // 10 * 6 + columns // 10).astype(np.int32)
    graph, planes = affinity_of(points, labels)
    for (low, high), found in zip(graph.edges, graph.affinity, strict=True):
        one, other = (points[(labels == k) & planes.inliers] for k in (low, high))
        d_p = cdist(one, other).min() / DELTA
        d_n = 1 - planes.normals[low] @ planes.normals[high]
        exact = np.exp(-(d_n**2 + d_p**2) / 0.08)
        assert found == pytest.approx(exact, rel=1e-6)
    assert len(graph.edges) == 4 * 5 + 3 * 6  # diagonal neighbours share no boundary


def test_scale_does_not_matter():
    points, labels = grid()
    points[..., 2] += 0.2 * np.abs(points[..., 0])
    for scale in (0.1, 10.0):
        planes = fit_planes(points * scale, labels, np.zeros(3), DELTA * scale, rng=np.random.default_rng(0))
        graph = measure_affinity(points * scale, labels, planes, DELTA * scale)
        assert graph.affinity == pytest.approx(affinity_of(points, labels)[0].affinity, rel=1e-6)


def test_no_plane_no_edge():
    points, labels = grid()
    points[labels == 1] = np.nan
    graph, planes = affinity_of(points, labels)
    assert len(graph.edges) == 0
    assert join_superpixels(graph, planes.valid).tolist() == [0, -1]


def test_nothing_at_all():
    graph, planes = affinity_of(np.full((4, 5, 3), np.nan), np.full((4, 5), -1, np.int32))
    assert len(graph.edges) == 0
    assert len(join_superpixels(graph, planes.valid)) == 0


def test_reach_is_the_distance_at_the_threshold():
    settings = AffinitySettings()
    assert np.exp(-(settings.reach**2) / (2 * settings.sigma**2)) == pytest.approx(settings.threshold)
    with pytest.raises(ValueError, match="sigma"):
        AffinitySettings(sigma=0)
