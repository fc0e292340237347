"""Texture kernels of the extension against plain references."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage import _native
from usdfoliage._native import cut_grid


def place_patches(exemplar, valid, source, color, known, patch, overlap, share, cuts, seed, threads):
    settings = _native.PlaceSettings(
        patch_px=patch,
        overlap_px=overlap,
        usage_weight=1.0,
        near_weight=1.0,
        candidate_share=share,
        max_places=1 << 20,
        cuts=cuts,
        seed=seed,
    )
    return _native.place_patches(
        _native.Exemplar(color=exemplar, valid=valid),
        _native.Synthesis(source=source, color=color, known=known),
        settings=settings,
        threads=threads,
    )


def refine_sources(
    exemplar, guide_of_exemplar, valid, source, color, guide, known, radius, weight, tries, seed, threads
):
    settings = _native.RefineSettings(radius=radius, guide_weight=weight, random_tries=tries, seed=seed)
    _native.refine_sources(
        _native.Exemplar(color=exemplar, valid=valid, guide=guide_of_exemplar),
        _native.Synthesis(source=source, color=color, known=known, guide=guide),
        settings=settings,
        threads=threads,
    )


def random_bits(seed, a, b):
    def mix(x):
        x ^= x >> 16
        x = x * 0x7FEB352D & 0xFFFFFFFF
        x ^= x >> 15
        x = x * 0x846CA68B & 0xFFFFFFFF
        return x ^ (x >> 16)

    return mix((mix(mix(seed) ^ a) + b) & 0xFFFFFFFF)


def reference_cost(exemplar, guide_of_exemplar, color, guide, y, x, place, radius, guide_weight):
    """Squared difference of two neighbourhoods, of what both have; the mean of it stands for the rest."""
    total = compared = 0
    for v, u in itertools.product(range(-radius, radius + 1), repeat=2):
        row, column, q = y + v, x + u, (place[0] + v, place[1] + u)
        inside = 0 <= row < len(color) and 0 <= column < color.shape[1]
        if inside and 0 <= q[0] < len(exemplar) and 0 <= q[1] < exemplar.shape[1]:
            total += int(((color[row, column].astype(int) - exemplar[q]) ** 2).sum())
            compared += 1
    total = total * (2 * radius + 1) ** 2 // compared
    return total + guide_weight * int(((guide[y, x].astype(int) - guide_of_exemplar[place]) ** 2).sum())


def reference_pass(exemplar, guide_of_exemplar, valid, source, color, guide, known, radius, weight, tries, seed):
    source, color = source.copy(), color.copy()
    rows, columns = known.shape
    h, w = valid.shape
    for phase, (row, column) in enumerate(((0, 0), (1, 1), (1, 0), (0, 1))):
        found = {}
        for y, x in itertools.product(range(row, rows, 2), range(column, columns, 2)):
            best = tuple(source[y, x])
            window = list(
                itertools.product(
                    range(max(y - radius, 0), min(y + radius + 1, rows)),
                    range(max(x - radius, 0), min(x + radius + 1, columns)),
                )
            )
            verbatim = all(not known[q] and tuple(source[q] - source[y, x]) == (q[0] - y, q[1] - x) for q in window)
            if known[y, x] == 2 or verbatim:
                continue
            arguments = (radius, weight)
            min_cost = reference_cost(exemplar, guide_of_exemplar, color, guide, y, x, best, *arguments)
            seen = {best}

            def consider(place, numerator, denominator, y=y, x=x, seen=seen, arguments=arguments):
                nonlocal best, min_cost
                if not (0 <= place[0] < h and 0 <= place[1] < w and valid[place]) or place in seen:
                    return
                seen.add(place)
                limit = min_cost * denominator // numerator
                cost = reference_cost(exemplar, guide_of_exemplar, color, guide, y, x, place, *arguments)
                if cost < limit:
                    best, min_cost = place, cost

            for reach in (1, 2, 4):
                for dy, dx in itertools.product((-reach, 0, reach), repeat=2):
                    if 0 <= y + dy < rows and 0 <= x + dx < columns:
                        other = source[y + dy, x + dx]
                        consider((int(other[0]) - dy, int(other[1]) - dx), 1, 1)
            for k in range(tries):
                bits = random_bits(seed, y * columns + x, 4 * k + phase)
                reach = max(h, w) >> k
                if reach == 0:
                    break
                dy = ((bits & 0xFFFF) * (2 * reach + 1) >> 16) - reach
                dx = ((bits >> 16) * (2 * reach + 1) >> 16) - reach
                consider((int(best[0]) + dy, int(best[1]) + dx), 9, 8)
            found[y, x] = best
        for pixel, place in found.items():
            source[pixel] = place
            if not known[pixel]:
                color[pixel] = exemplar[place]
    return source, color


def colors(rng, rows, columns):
    image = rng.integers(0, 1024, (rows, columns, 4)).astype(np.int16)
    image[..., 3] = 0
    return image


def start(rng, exemplar, valid, shape, known):
    places = np.argwhere(valid).astype(np.int32)
    source = places[rng.integers(0, len(places), shape)]
    source[: shape[0] // 2] = places[0] + np.stack(np.indices(shape), -1)[: shape[0] // 2] % 4  # some of it verbatim
    color = np.where(known[..., None] != 0, colors(rng, *shape), exemplar[source[..., 0], source[..., 1]])
    return np.ascontiguousarray(source), np.ascontiguousarray(color)


@pytest.mark.parametrize("seed", range(4))
def test_a_pass_does_what_the_reference_does(seed):
    rng = np.random.default_rng(seed)
    exemplar, guide_of_exemplar = colors(rng, 11, 9), colors(rng, 11, 9)
    valid = (rng.random((11, 9)) < 0.8).astype(np.uint8)
    valid[:4, :4] = 1
    known = rng.choice([0, 0, 0, 0, 1, 2], size=(8, 13)).astype(np.uint8)
    source, color = start(rng, exemplar, valid, known.shape, known)
    guide = colors(rng, *known.shape)
    radius, weight, tries = 1 + seed % 2, seed, 3
    expected = reference_pass(
        exemplar, guide_of_exemplar, valid, source, color, guide, known, radius, weight, tries, 7 + seed
    )
    refine_sources(exemplar, guide_of_exemplar, valid, source, color, guide, known, radius, weight, tries, 7 + seed, 1)
    np.testing.assert_array_equal(source, expected[0])
    np.testing.assert_array_equal(color, expected[1])


def test_threads_do_not_change_the_result():
    rng = np.random.default_rng(0)
    exemplar = colors(rng, 40, 36)
    valid = np.ones((40, 36), np.uint8)
    known = np.zeros((50, 61), np.uint8)
    known[20:25, 20:30] = 1
    results = []
    for threads in (1, 2, 5):
        source = np.full((50, 61, 2), -1, np.int32)
        source[known != 0] = (3, 4)
        color = np.zeros((50, 61, 4), np.int16)
        place_patches(exemplar, valid, source, color, known, 12, 4, 0.7, 4, 5, threads)
        refine_sources(exemplar, exemplar, valid, source, color, color.copy(), known, 2, 1, 4, 9, threads)
        results.append((source, color))
    for source, color in results[1:]:
        np.testing.assert_array_equal(source, results[0][0])
        np.testing.assert_array_equal(color, results[0][1])


def test_what_is_already_like_the_exemplar_stays():
    rng = np.random.default_rng(1)
    exemplar = colors(rng, 12, 14)
    source = np.stack(np.indices((12, 14)), -1).astype(np.int32)
    color, before = exemplar.copy(), source.copy()
    none = np.zeros((12, 14), np.uint8)
    refine_sources(exemplar, exemplar, none + 1, source, color, exemplar, none, 3, 2, 5, 1, 2)
    np.testing.assert_array_equal(source, before)


def test_patches_fill_what_is_free_and_keep_what_is_known():
    rng = np.random.default_rng(2)
    exemplar = colors(rng, 30, 30)
    valid = np.ones((30, 30), np.uint8)
    valid[10:, 12:] = 0
    known = np.zeros((33, 47), np.uint8)
    known[5:20, 6:20] = 1
    source = np.full((33, 47, 2), -1, np.int32)
    source[known != 0] = 0
    color = colors(rng, 33, 47)
    before = color.copy()
    assert place_patches(exemplar, valid, source, color, known, 10, 4, 1.0, 2, 3, 1) > 12
    assert (source >= 0).all()
    assert valid[source[..., 0], source[..., 1]].all()
    np.testing.assert_array_equal(color[known != 0], before[known != 0])
    free = known == 0
    np.testing.assert_array_equal(color[free], exemplar[source[..., 0], source[..., 1]][free])


def test_without_room_for_a_patch_nothing_is_placed():
    exemplar = colors(np.random.default_rng(3), 8, 8)
    valid = np.ones((8, 8), np.uint8)
    valid[4] = 0
    none = np.zeros((9, 9), np.uint8)
    source = np.full((9, 9, 2), -1, np.int32)
    assert place_patches(exemplar, valid, source, np.zeros((9, 9, 4), np.int16), none, 6, 2, 1, 1, 0, 1) == 0
    assert (source == -1).all()


def cut_cost(side, down, right, terminal):
    cost = down[side != np.roll(side, -1, 0)].sum() + right[side != np.roll(side, -1, 1)].sum()
    return cost + terminal[(terminal > 0) & (side == 1)].sum() - terminal[(terminal < 0) & (side == 0)].sum()


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 100_000), shape=st.sampled_from([(1, 1), (1, 5), (3, 3), (4, 3), (2, 5)]), wrap=st.booleans()
)
def test_a_cut_is_the_cheapest_of_all(seed, shape, wrap):
    rng = np.random.default_rng(seed)
    down, right = rng.integers(0, 20, (2, *shape)).astype(np.int32)
    if not wrap or shape[0] == 1:
        down[-1] = 0
    if not wrap or shape[1] == 1:
        right[:, -1] = 0
    terminal = (rng.integers(-30, 31, shape) * (rng.random(shape) < 0.6)).astype(np.int32)
    side = cut_grid(down, right, terminal)
    best = min(
        cut_cost(np.array(trial).reshape(shape), down, right, terminal)
        for trial in itertools.product((0, 1), repeat=side.size)
    )
    assert cut_cost(side, down, right, terminal) == best
