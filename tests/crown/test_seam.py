import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import maximum_flow
from usdfoliage.crown.seam import cut_seam, seam_costs


def sides(height, width):
    """First is kept in the leftmost column, second in the rightmost."""
    keep_first, keep_second = np.zeros((2, height, width), dtype=bool)
    keep_first[:, 0] = keep_second[:, -1] = True
    return keep_first, keep_second


def cut_cost(taken, costs, allowed=None):
    part = np.ones_like(taken) if allowed is None else allowed
    return sum(
        float(cost[(taken != np.roll(taken, -1, axis)) & part & np.roll(part, -1, axis)].sum())
        for axis, cost in enumerate(costs)
    )


def test_seam_follows_the_pixels_where_the_images_agree():
    height, width = 12, 16
    rng = np.random.default_rng(1)
    first = rng.random((height, width, 3))
    second = first + 0.5
    column = (6 + np.rint(3 * np.sin(np.arange(height) / 2))).astype(int)  # a winding path, joined at its corners
    for row in range(height):
        low, high = sorted((column[row], column[max(row - 1, 0)]))
        second[row, low : high + 2] = first[row, low : high + 2]
    keep_first, keep_second = sides(height, width)
    taken = cut_seam(first, second, keep_first, keep_second)
    assert cut_cost(taken, seam_costs(first, second)) == 0
    np.testing.assert_array_equal(np.where(taken[..., None], second, first)[:, 0], first[:, 0])


def test_seam_prefers_texture_to_flat_ground():
    first = np.full((8, 12, 3), 0.5)
    first[:, 6:9] += np.where(np.indices((8, 3)).sum(0) % 2, 0.4, -0.4)[..., None]  # a checkered band
    second = first + 0.1
    taken = cut_seam(first, second, *sides(8, 12))
    assert set(np.argmax(taken, axis=1)) <= {7, 8}


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    shape=st.sampled_from([(2, 5), (3, 4), (4, 3), (1, 6), (4, 4)]),
    wrap=st.tuples(st.booleans(), st.booleans()),
    holes=st.booleans(),
)
def test_cut_costs_what_brute_force_finds(seed, shape, wrap, holes):
    rng = np.random.default_rng(seed)
    first, second = rng.random((2, *shape, 3))
    keep_first, keep_second = np.zeros((2, *shape), dtype=bool)
    ends = rng.choice(first[..., 0].size, 4, replace=False)
    keep_first.flat[ends[:2]] = True
    keep_second.flat[ends[2:]] = True
    allowed = (rng.random(shape) < 0.8) | keep_first | keep_second if holes else None
    costs = seam_costs(first, second, wrap=wrap, allowed=allowed)

    taken = cut_seam(first, second, keep_first, keep_second, wrap=wrap, allowed=allowed)

    free = np.flatnonzero(~keep_first & ~keep_second & (True if allowed is None else allowed))
    best = np.inf
    for choice in itertools.product((False, True), repeat=len(free)):
        trial = keep_second.copy()
        trial.flat[free] = choice
        best = min(best, cut_cost(trial, costs, allowed))
    assert cut_cost(taken, costs, allowed) == pytest.approx(best, abs=1e-5)
    assert not taken[keep_first].any()
    assert taken[keep_second].all()
    if allowed is not None:
        assert not taken[~allowed].any()


@pytest.mark.parametrize("wrap", [(False, False), (False, True), (True, True)])
def test_cut_costs_what_a_general_maximum_flow_finds(wrap):
    rng = np.random.default_rng(6)
    first = rng.random((24, 30, 3))
    second = np.clip(first + rng.normal(scale=0.2, size=first.shape), 0, 1)
    keep_first, keep_second = sides(24, 30)
    keep_second[10:14, 12:15] = True
    costs = seam_costs(first, second, wrap=wrap)
    node = np.arange(720).reshape(24, 30) + 2
    node[keep_first], node[keep_second] = 0, 1
    edges = [(node, np.roll(node, -1, axis), cost) for axis, cost in enumerate(costs)]
    source, target, cost = (np.concatenate([edge[k].ravel() for edge in edges]) for k in range(3))
    inner = (source != target) & (source + target != 1)
    capacity = np.rint(cost[inner] * 1e5).astype(np.int32)
    rows, columns = np.append(source[inner], target[inner]), np.append(target[inner], source[inner])
    graph = csr_array(coo_array((np.append(capacity, capacity), (rows, columns)), shape=(722, 722)))
    between_ends = cost[(source != target) & (source + target == 1)].sum()
    flow = maximum_flow(graph, 0, 1).flow_value * 1e-5 + between_ends
    taken = cut_seam(first, second, keep_first, keep_second, wrap=wrap)
    assert cut_cost(taken, costs) == pytest.approx(flow, abs=1e-2)


def test_a_cylinder_has_a_seam_that_closes():
    rng = np.random.default_rng(3)
    first, second = rng.random((2, 6, 20, 3))
    keep_first, keep_second = np.zeros((2, 6, 20), dtype=bool)
    keep_first[0] = keep_second[-1] = True
    taken = cut_seam(first, second, keep_first, keep_second, wrap=(False, True))
    rolled = cut_seam(*(np.roll(x, 7, axis=1) for x in (first, second, keep_first, keep_second)), wrap=(False, True))
    np.testing.assert_array_equal(np.roll(taken, 7, axis=1), rolled)


def test_outside_allowed_nothing_is_looked_at():
    rng = np.random.default_rng(4)
    first, second = rng.random((2, 6, 9, 3))
    allowed = np.ones((6, 9), dtype=bool)
    allowed[:, 4] = False
    allowed[3, 4] = True  # the one bridge
    first[~allowed] = np.nan
    second[~allowed] = np.inf
    taken = cut_seam(first, second, *sides(6, 9), allowed=allowed)
    assert not taken[:, :3].any()
    assert taken[:, 6:].all()


def test_a_large_seam_does_not_overflow():
    rng = np.random.default_rng(5)
    first = np.zeros((64, 64, 3))
    second = rng.random((64, 64, 3)) * 1000.0
    taken = cut_seam(first, second, *sides(64, 64))
    assert not taken[:, 0].any()
    assert taken[:, -1].all()


def test_what_cannot_be_cut_is_refused():
    image = np.zeros((4, 5, 3))
    keep_first, keep_second = sides(4, 5)
    none = np.zeros((4, 5), dtype=bool)
    with pytest.raises(ValueError, match="4 pixels are to be kept of both"):
        cut_seam(image, image, keep_first, keep_second | keep_first)
    with pytest.raises(ValueError, match="kept of the first image"):
        cut_seam(image, image, none, keep_second)
    with pytest.raises(ValueError, match="kept of the second image"):
        cut_seam(image, image, keep_first, none)
    with pytest.raises(ValueError, match="must both be"):
        cut_seam(image, image[:3], keep_first, keep_second)
    with pytest.raises(ValueError, match="keep_first must be bool"):
        cut_seam(image, image, keep_first[:3], keep_second)
    with pytest.raises(ValueError, match="allowed must be bool"):
        cut_seam(image, image, keep_first, keep_second, allowed=np.ones((4, 5)))
    with pytest.raises(ValueError, match="finite"):
        cut_seam(image * np.nan, image, keep_first, keep_second)
