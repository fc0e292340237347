"""The species of trees that are seen from above: by colour, form and height, or drawn by share in patches.

What the thesis leaves to the future (Argudo, section 6.2: plants are drawn independently by their shares) is our own:
a mixture whose means are those that the user describes, whose light and spread are measured on the trees themselves.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import ndtr

from usdfoliage.forest.plants_file import PlantRow
from usdfoliage.forest.raster import Raster, sample_bilinear

Floats = NDArray[np.float64]

ROUNDS = 8  # of measuring light and spread, and assigning anew
COLOR_SPREAD = 0.25  # of the logarithm of red over green and blue over green, at first
FORM_SPREAD = 0.2  # of the logarithm of radius over height, at first
NARROWEST = 0.05  # spread of either
HEIGHT_SPREAD = 0.15  # of the logarithm of the height, beyond the range
NEIGHBOURS = 6
AGREEMENT = 0.25  # of a neighbour of the same species, as logarithm of odds
DARKEST = 1e-4
RINGS = (0.25, 0.5, 0.7)  # of a crown's radius, on which its colour is read
PER_RING = 12
BLUEST = 0.8  # blue of leaves over the greater of their red and green; roads and shadows on them have more


@dataclass(frozen=True, kw_only=True, eq=False)
class SeenTrees:
    """What is known of trees from above."""

    ground_m: Floats  # (N, 2)
    height_m: Floats  # (N,), NaN where it is not known
    radius_m: Floats  # (N,), of the crown; NaN where it is not known
    color: Floats  # (N, 3), linear; NaN where it is not known


def assign_species(
    trees: SeenTrees, rows: Sequence[PlantRow], allowed: NDArray[np.bool_], seed: int, patch_m: float
) -> NDArray[np.int64]:
    """(N,) which row each tree is, -1 where none may stand there.

    Args:
        trees: As they are seen.
        rows: R of one kind.
        allowed: (N, R), whether the row may stand on the ground there.
        seed: Of what is drawn.
        patch_m: Diameter of patches of one species, where nothing but the share decides.
    """
    count = len(trees.ground_m)
    share = np.array([row.share for row in rows])
    with np.errstate(divide="ignore"):
        prior = np.where(allowed, np.log(share), -np.inf)
    if not count:
        return np.zeros(0, np.int64)
    draw = draw_in_patches(trees.ground_m, len(rows), seed, patch_m)
    described = np.array([row.color is not None or row.form is not None for row in rows])
    colored = np.isfinite(trees.color).all(axis=1) & any(row.color is not None for row in rows)
    likelihood = _likelihood(trees, rows, prior) if described.any() else _height_likelihood(trees, rows)
    # A colour decides. Without it forms and heights leave several rows possible: of these one is drawn by its odds.
    score = prior + likelihood + draw * np.where(colored, 0.0, 1.0)[:, None]
    if described.any():
        score = _with_neighbours(trees.ground_m, score)
    best = np.argmax(score + 1e-9 * draw, axis=1)
    return np.where(np.isfinite(score[np.arange(count), best]), best, -1)


def draw_in_patches(ground_m: Floats, count: int, seed: int, patch_m: float) -> Floats:
    """(N, count) Gumbel numbers that differ little between places near to each other.

    The largest of them plus the logarithms of shares falls on each by its share, as independent ones would, in patches.
    """
    rng = np.random.default_rng(seed)
    waves = 32
    field = np.empty((len(ground_m), count))
    for number in range(count):
        # A sum of many plane waves of random direction is nearly normal at each place.
        wave = rng.normal(0.0, 2 * np.pi / (2.5 * max(patch_m, 1e-3)), (waves, 2))
        phase = rng.uniform(0, 2 * np.pi, waves)
        field[:, number] = np.sqrt(2 / waves) * np.cos(ground_m @ wave.T + phase).sum(axis=1)
    return np.asarray(-np.log(-np.log(np.clip(ndtr(field), 1e-12, 1 - 1e-12))))


def _likelihood(trees: SeenTrees, rows: Sequence[PlantRow], prior: Floats) -> Floats:
    """(N, R) logarithms, with the light and the spreads that the trees themselves have."""
    chroma, wanted = _chromaticity(trees.color), _chromaticity(np.array([row.color or (np.nan,) * 3 for row in rows]))
    with np.errstate(divide="ignore", invalid="ignore"):
        form = np.log(trees.radius_m / trees.height_m)
        wanted_form = np.log([row.form or np.nan for row in rows])
    off_color = chroma[:, None] - wanted  # (N, R, 2)
    off_form = form[:, None] - wanted_form
    light, form_shift = np.zeros(2), 0.0
    color_spread, form_spread = COLOR_SPREAD, FORM_SPREAD
    height = _height_likelihood(trees, rows)
    for _ in range(ROUNDS):
        color = -(((off_color - light) / color_spread) ** 2).sum(axis=-1) / 2
        formed = -(((off_form - form_shift) / form_spread) ** 2) / 2
        # A row without a description is as likely as one whose colours fit as most do.
        total = np.where(np.isfinite(color), color, -1.0) + np.where(np.isfinite(formed), formed, -0.5) + height
        odds = total + prior
        best = np.argmax(odds, axis=1)
        mine = np.arange(len(best)), best
        color_off, form_off = off_color[mine], off_form[mine]
        good = np.isfinite(color_off).all(axis=1) & np.isfinite(odds[mine])
        if good.sum() >= 3 * len(rows):
            light = np.median(color_off[good], axis=0)
            color_spread = max(NARROWEST, 1.4826 * float(np.median(np.abs(color_off[good] - light))))
        good = np.isfinite(form_off) & np.isfinite(odds[mine])
        if good.sum() >= 3 * len(rows):
            form_shift = float(np.median(form_off[good]))
            form_spread = max(NARROWEST, 1.4826 * float(np.median(np.abs(form_off[good] - form_shift))))
    return np.asarray(total)


def _height_likelihood(trees: SeenTrees, rows: Sequence[PlantRow]) -> Floats:
    """(N, R) logarithms: even within a row's heights, falling beyond them."""
    low, high = np.log(np.array([row.height_m for row in rows])).T
    with np.errstate(divide="ignore", invalid="ignore"):
        height = np.log(trees.height_m)[:, None]
    beyond = np.maximum(np.maximum(low - height, height - high), 0.0)
    return np.where(np.isfinite(height), -((beyond / HEIGHT_SPREAD) ** 2) / 2, 0.0)


def _with_neighbours(ground_m: Floats, score: Floats) -> Floats:
    """Scores (N, R) to which neighbours add, by how sure these are themselves."""
    if len(ground_m) <= NEIGHBOURS:
        return score
    near = np.asarray(cKDTree(ground_m).query(ground_m, k=NEIGHBOURS + 1)[1])
    finite = np.where(np.isfinite(score), score, -1e9)
    odds = np.exp(finite - finite.max(axis=1, keepdims=True))
    odds /= odds.sum(axis=1, keepdims=True)
    return np.asarray(score + AGREEMENT * odds[near[:, 1:]].sum(axis=1))


def _chromaticity(color: Floats) -> Floats:
    """(N, 2) logarithms of red over green and of blue over green."""
    safe = np.maximum(color, DARKEST)
    return np.asarray(np.log(safe[..., [0, 2]] / safe[..., [1]]))


def crown_colors(linear: Raster, ground_m: Floats, radius_m: Floats) -> Floats:
    """(N, 3) the mean colour over each crown.

    Args:
        linear: (H, W, 3) colours of the orthophoto.
        ground_m: (N, 2) the crowns' middles.
        radius_m: (N,) their radii.
    """
    angle = np.linspace(0, 2 * np.pi, PER_RING, endpoint=False)
    around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    disc = np.concatenate([[(0.0, 0.0)], *(share * around for share in RINGS)])
    places_m = ground_m[:, None] + radius_m[:, None, None] * disc
    colors = sample_bilinear(linear, places_m.reshape(-1, 2)).reshape(len(ground_m), len(disc), 3)
    return np.asarray(colors.mean(axis=1))


def are_of_leaves(colors: Floats) -> NDArray[np.bool_]:
    """(N,) whether mean linear colours (N, 3) can be those of leaves of any season; roads and water have more blue."""
    return np.asarray(colors[:, 2] < BLUEST * np.maximum(colors[:, 0], colors[:, 1]))
