"""Species by colour in any light, by share in patches."""

from pathlib import Path

import numpy as np
from usdfoliage.forest.kinds import PlantKind
from usdfoliage.forest.plants_file import PlantRow
from usdfoliage.forest.species import SeenTrees, assign_species, draw_in_patches

RNG = np.random.default_rng(5)


def row(species: str, share: float, **more) -> PlantRow:
    return PlantRow(species=species, kind=PlantKind.TREE, asset=Path("x"), share=share, height_m=(2.0, 30.0), **more)


def trees(count: int, color: np.ndarray | None = None, height_m: np.ndarray | None = None) -> SeenTrees:
    unknown = np.full(count, np.nan)
    height_m = unknown if height_m is None else height_m
    return SeenTrees(
        ground_m=RNG.uniform(0, 300, (count, 2)),
        height_m=height_m,
        radius_m=0.25 * height_m,
        color=np.full((count, 3), np.nan) if color is None else color,
    )


def test_colors_decide_in_a_light_that_is_not_that_of_the_description():
    rows = [row("oak", 0.7, color=(0.11, 0.155, 0.047)), row("maple", 0.3, color=(0.22, 0.13, 0.033))]
    true = (RNG.random(400) < 0.3).astype(np.int64)
    described = np.array([each.color for each in rows])
    light = np.array([0.9, 0.7, 0.45])  # low and red
    color = described[true] * light * RNG.uniform(0.5, 1.2, (400, 1)) * np.exp(0.08 * RNG.standard_normal((400, 3)))
    found = assign_species(trees(400, color), rows, np.ones((400, 2), bool), 0, 20.0)
    assert (found == true).mean() > 0.97


def test_what_may_not_stand_there_does_not():
    rows = [row("oak", 1.0, color=(0.1, 0.2, 0.05))]
    allowed = np.array([[True], [False]])
    assert assign_species(trees(2), rows, allowed, 0, 20.0).tolist() == [0, -1]
    assert len(assign_species(trees(0), rows, np.ones((0, 1), bool), 0, 20.0)) == 0


def test_shares_alone_are_kept_and_neighbours_agree():
    rows = [row("a", 0.6), row("b", 0.3), row("c", 0.1)]
    seen = trees(6000)
    counts, agree = np.zeros(3), []
    for seed in range(12):
        found = assign_species(seen, rows, np.ones((6000, 3), bool), seed, 20.0)
        counts += np.bincount(found, minlength=3)
        near = np.linalg.norm(seen.ground_m[:300, None] - seen.ground_m, axis=2)
        near[np.arange(300), np.arange(300)] = np.inf
        agree.append((found[:300] == found[np.argmin(near, axis=1)]).mean())
    np.testing.assert_allclose(counts / counts.sum(), [0.6, 0.3, 0.1], atol=0.08)
    assert np.mean(agree) > 0.8  # of independent draws .46 would


def test_drawn_numbers_are_those_of_a_gumbel_and_of_the_seed():
    ground_m = RNG.uniform(0, 5000, (4000, 2))
    drawn = draw_in_patches(ground_m, 2, 3, 10.0)
    np.testing.assert_array_equal(drawn, draw_in_patches(ground_m, 2, 3, 10.0))
    assert abs(drawn.mean() - 0.5772) < 0.1
    assert abs(drawn.std() - np.pi / np.sqrt(6)) < 0.1
