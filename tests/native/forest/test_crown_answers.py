"""Facts and answers of places in a picture from above, against numpy; and the best of crowns, against all pairs."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage._native import choose_crowns, crown_answers, crown_facts
from usdfoliage.forest.crown_tiles import ANGLES, RINGS, CrownTile, tile_places

PAIRS = range(1, ANGLES // 2)


def tile_of(rng, channels):
    values = rng.standard_normal((channels, 46, 57)) + (0 if channels == 4 else 6)
    return CrownTile(channels=values.astype(np.float32), seen=np.ones((30, 41), bool), pixel_from_cell=np.zeros((2, 3)))


def expected_facts(channels, places, offsets):
    """(N, K) by the definitions, in float64."""
    flat = channels.reshape(len(channels), -1).astype(np.float64)
    middle = flat[:, places]
    around = flat[:, places[:, None, None] + offsets]  # (C, N, R, A)
    paired = [(around[..., number] + around[..., -number]) / 2 for number in PAIRS]
    sides = np.stack([around[..., 0], *paired, around[..., ANGLES // 2]], axis=-1)
    uneven = sum(np.abs(around[0, ..., number] - around[0, ..., -number]) for number in PAIRS) / ANGLES
    means = around.mean(axis=-1)
    inside = (middle + 2 * means[..., 0] + 3 * means[..., 1]) / 6
    outside = means[..., 4:7].mean(axis=-1)
    off = sides[0] - inside[0][:, None, None]
    spread = np.sqrt((off**2).mean(axis=(1, 2))) + (0.3 if len(channels) == 1 else 0.05)
    rings = np.concatenate([uneven[..., None], off], axis=-1) / spread[:, None, None]
    facts = [(middle[0] - inside[0]) / spread, np.log(spread), *rings.reshape(len(places), -1).T]
    if len(channels) == 1:
        high = np.maximum(inside[0], 0) + 1
        return np.stack([*facts, np.log(high), outside[0] / high], axis=-1)
    apart = (inside - outside)[1:3]
    distance = np.linalg.norm(apart, axis=0)
    toward = apart / np.maximum(distance, 0.02)
    level = (toward * outside[1:3]).sum(axis=0)
    facts += [(toward * middle[1:3]).sum(axis=0) - level, np.log(distance + 0.02), middle[3] - outside[3]]
    colors = (toward[..., None, None] * sides[1:3]).sum(axis=0) - level[:, None, None]
    rough = means[3] - outside[3][:, None]
    rings = np.concatenate([rough[..., None], colors], axis=-1)
    return np.stack([*facts, *rings.reshape(len(places), -1).T], axis=-1)


def network(rng, facts):
    sizes = (facts.shape[1], 13, 6, 1)
    layers = [
        ((rng.standard_normal((a, b)) / np.sqrt(a)).astype(np.float32), rng.standard_normal(b).astype(np.float32))
        for a, b in itertools.pairwise(sizes)
    ]
    return {
        "middle": facts.mean(axis=0).astype(np.float32),
        "spread": (facts.std(axis=0) / 3).astype(np.float32),  # so that some facts are cut off
        "layers": layers,
    }


def expected_answers(facts, middle, spread, layers):
    answer = np.clip((facts - middle) / spread, -4, 4)
    for number, (matrix, offset) in enumerate(layers):
        answer = answer @ matrix + offset
        answer = np.maximum(answer, 0) if number < len(layers) - 1 else answer
    return 1 / (1 + np.exp(-answer[:, 0]))


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**31), channels=st.sampled_from([1, 4]), share=st.sampled_from([0.003, 0.1, 0.7]))
def test_facts_and_answers_are_those_of_numpy(seed, channels, share):
    rng = np.random.default_rng(seed)
    tile = tile_of(rng, channels)
    mask = rng.random(tile.seen.shape) < share
    mask[::2, ::2] = True  # every second one in a row, as a search asks
    asked = tile_places(tile, mask)
    facts = crown_facts(*asked, threads=1)
    expected = expected_facts(*asked)
    assert facts == pytest.approx(expected, rel=1e-4, abs=1e-4)
    numbers = network(rng, expected)
    answers = crown_answers(*asked, **numbers, threads=1)
    assert answers == pytest.approx(expected_answers(expected, **numbers), abs=1e-4)


@pytest.mark.parametrize("channels", [1, 4])
def test_threads_and_neighbours_do_not_change_a_bit(channels):
    rng = np.random.default_rng(3)
    tile = tile_of(rng, channels)
    mask = rng.random(tile.seen.shape) < 0.8
    channels, places, offsets = tile_places(tile, mask)
    facts = crown_facts(channels, places, offsets, threads=1)
    numbers = network(rng, facts)
    answers = crown_answers(channels, places, offsets, **numbers, threads=1)
    assert np.array_equal(crown_facts(channels, places, offsets, threads=4), facts)
    assert np.array_equal(crown_answers(channels, places, offsets, **numbers, threads=4), answers)
    order = rng.permutation(len(places))
    turned = crown_answers(channels, places[order], offsets, **numbers, threads=2)
    assert np.array_equal(turned, answers[order])


def test_nothing_asked_is_nothing_answered():
    rng = np.random.default_rng(0)
    tile = tile_of(rng, 4)
    asked = tile_places(tile, np.zeros_like(tile.seen))
    facts = crown_facts(*asked, threads=0)
    assert facts.shape == (0, 2 + 8 * len(RINGS) + 3 + 8 * len(RINGS))
    one = network(rng, np.ones((1, facts.shape[1])))
    assert crown_answers(*asked, **one, threads=0).shape == (0,)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**31), count=st.integers(0, 120), far=st.sampled_from([0.0, 5e6]))
def test_the_best_crowns_stay_and_none_lies_within_another(seed, count, far):
    rng = np.random.default_rng(seed)
    places, radii = far + rng.uniform(-20, 20, (count, 2)), rng.uniform(0.9, 7.0, count)
    order = rng.permutation(count).astype(np.int32)
    kept = []
    for own in order.tolist():
        if all(np.hypot(*(places[own] - places[other])) >= 0.6 * (radii[own] + radii[other]) for other in kept):
            kept.append(own)
    assert choose_crowns(places, radii, order, apart=0.6).tolist() == kept
