"""What the texture and the sky of a photograph make known of its leaves, on pictures that are drawn."""

import cv2
import numpy as np
import pytest
from usdfoliage.sketch.before_sky import complete_before_sky
from usdfoliage.sketch.bounds import bound_crown, view_from_the_side
from usdfoliage.sketch.drawing import close_gaps
from usdfoliage.sketch.foliage import find_sky
from usdfoliage.sketch.leaf_fill import LeafFillSettings, fill_gaps
from usdfoliage.sketch.leaf_scale import measure_leaf_length
from usdfoliage.sketch.proposal import complete_proposal
from usdfoliage.sketch.sky_behind import share_of_tree
from usdfoliage.sketch.stroke_margin import measure_margin

SIZE = 500
SKY, LEAF = np.array([120.0, 160.0, 230.0]), np.array([60.0, 90.0, 30.0])


def disc(radius: float, center: tuple[float, float] = (SIZE / 2, SIZE / 2)) -> np.ndarray:
    y, x = np.mgrid[:SIZE, :SIZE] + 0.5
    return np.hypot(x - center[0], y - center[1]) < radius


def circle(radius: float) -> np.ndarray:
    turn = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    return SIZE / 2 + radius * np.column_stack([np.cos(turn), np.sin(turn)])


def draw_leaves(length_px: float, seed: int = 0) -> np.ndarray:
    """Ellipses half as wide as long, in any direction and brightness, seen from any side."""
    rng = np.random.default_rng(seed)
    picture = np.full((SIZE, SIZE, 3), 60, np.uint8)
    for _ in range(int(24 * (SIZE / length_px) ** 2)):
        middle, turn = 16 * rng.uniform(0, SIZE, 2), rng.uniform(0, 360)
        light = float(np.clip(rng.normal(100, 30), 10, 220))
        half = 8 * length_px * np.exp(0.15 * rng.standard_normal())
        axes = int(half), int(0.5 * half * rng.uniform(0.35, 1))
        color = (0.8 * light, light, 0.4 * light)
        cv2.ellipse(picture, (int(middle[0]), int(middle[1])), axes, turn, 0, 360, color, -1, cv2.LINE_AA, 4)
    return cv2.GaussianBlur(picture, (0, 0), 0.6)


@pytest.mark.parametrize("length_px", [10, 20, 30])
def test_the_length_of_drawn_leaves_is_measured(length_px):
    mask = disc(230)
    assert measure_leaf_length(draw_leaves(length_px), mask, float(np.sqrt(mask.sum()))) == pytest.approx(
        length_px, rel=0.3
    )


def test_a_plain_picture_and_few_pixels_have_no_length_of_leaves():
    plain = np.full((SIZE, SIZE, 3), 90, np.uint8)
    assert measure_leaf_length(plain, disc(200), 350.0) is None
    assert measure_leaf_length(draw_leaves(20), disc(4), 7.0) is None


@pytest.mark.parametrize("share", [0.25, 0.5, 0.75])
def test_the_share_of_leaves_in_a_mixed_pixel_is_known(share):
    tree = disc(120)
    fringe = disc(124) & ~tree
    colors = np.where(tree[..., None], LEAF, SKY)
    colors[fringe] = share * LEAF + (1 - share) * SKY
    behind = share_of_tree(colors, ~tree & ~fringe, tree, 240.0)
    assert behind.known[fringe].all()
    np.testing.assert_allclose(behind.share[fringe], share, atol=0.05)


def test_pixels_far_from_the_sky_have_no_share():
    tree = disc(120)
    behind = share_of_tree(np.where(tree[..., None], LEAF, SKY), ~tree, tree, 240.0)
    assert not behind.known[SIZE // 2, SIZE // 2]


@pytest.mark.parametrize("margin_px", [4, 10, 20])
def test_the_margin_of_a_stroke_is_measured_before_the_sky(margin_px):
    leaves = disc(120)
    sky = ~leaves
    sky[SIZE // 2 :] = False  # grass
    margin = measure_margin(circle(120 + margin_px), leaves, sky, 240.0)
    assert margin is not None
    assert margin.middle_px == pytest.approx(margin_px, abs=1.5)
    assert margin.spread_px < 1.5


def test_a_stroke_without_sky_behind_has_no_margin():
    leaves = disc(120)
    assert measure_margin(circle(130), leaves, np.zeros_like(leaves), 240.0) is None
    assert measure_margin(circle(130), np.zeros_like(leaves), ~leaves, 240.0) is None


def test_a_proposal_is_completed_by_what_stands_before_the_sky():
    row = np.arange(SIZE)[:, None]
    sky = np.repeat(row < 300, SIZE, axis=1)
    crown = disc(130, (250, 230))
    solid = crown | ~sky
    core = disc(60, (250, 290))
    colors = np.where(solid[..., None], LEAF, SKY)
    complete = complete_before_sky(core, ~solid, colors)
    upper = crown & (row < 295)
    assert (complete & upper).sum() > 0.97 * upper.sum()
    assert (complete & ~crown & (row < 295)).sum() < 0.03 * crown.sum()


def test_a_plant_that_joins_a_crown_in_its_last_rows_before_the_sky_makes_it_no_wider():
    row, column = np.mgrid[:SIZE, :SIZE]
    crown = disc(130, (250, 230))
    beside = (row > 288) & (column > 350) & (column < 460)
    solid = crown | beside | (row >= 300)
    colors = np.where(solid[..., None], LEAF, SKY)
    complete = complete_before_sky(disc(60, (250, 290)), ~solid, colors)
    assert complete[310:, 400:].sum() == 0
    assert complete[310:][crown[310:]].mean() > 0.8


def test_sky_in_a_gap_far_from_the_crowns_border_is_no_color_of_leaves():
    tree = disc(200)
    mixed = 0.5 * (np.asarray(LEAF, float) + np.asarray(SKY, float))
    colors = np.where(tree[..., None], LEAF, SKY).astype(float)
    colors[245:255, 245:255] = mixed
    behind = share_of_tree(colors, ~tree, tree, 400.0)
    assert not behind.known[250, 250]
    assert behind.before_sky[250, 250]
    assert behind.share[250, 250] < 0.7
    assert behind.share[230, 250] > 0.9


def test_without_sky_a_proposal_stays_as_it_is():
    mask = disc(100)
    colors = np.tile(LEAF, (SIZE, SIZE, 1))
    assert complete_before_sky(mask, np.zeros_like(mask), colors) is mask


def test_gaps_get_leaves_from_twigs_beside_them():
    mask = np.zeros((SIZE, SIZE), bool)
    mask[200:300, 50:450] = True
    bounds = bound_crown(mask)
    twigs = np.column_stack([np.linspace(55, 445, 300), np.full(300, -250.0), np.zeros(300)])
    rng = np.random.default_rng(0)
    filled = fill_gaps(
        np.zeros_like(mask), mask, bounds.leaves, twigs, 40.0, 0.5, 10_000, rng, LeafFillSettings(rounds=6)
    )
    np.testing.assert_allclose(np.linalg.norm(filled.along, axis=1), 1)
    assert np.isin(filled.base[:, 0], twigs[:, 0]).all()
    tips = filled.base + 40.0 * 0.95 * filled.along
    assert bounds.shows_leaves(tips).mean() > 0.9
    drawn = np.zeros(mask.shape, np.uint8)
    for base, along in zip(filled.base, filled.along, strict=True):
        ends = [(round(float(p[0])), round(float(-p[1]))) for p in (base, base + 40.0 * along)]
        cv2.line(drawn, *ends, 1, 10)
    near = np.zeros_like(mask)
    near[222:278, 60:440] = True
    assert close_gaps(drawn > 0, 3)[near].mean() > 0.9


def test_no_more_leaves_fill_gaps_than_are_asked_for():
    mask = disc(150)
    twigs = np.array([[250.0, -250.0, 0.0], [240.0, -260.0, 0.0]])
    rng = np.random.default_rng(0)
    filled = fill_gaps(np.zeros_like(mask), mask, mask, twigs, 20.0, 0.5, 3, rng)
    assert 1 <= len(filled.base) <= 3
    nothing = fill_gaps(np.zeros_like(mask), mask, mask, np.zeros((0, 3)), 20.0, 0.5, 3, rng)
    assert len(nothing.base) == 0


@pytest.mark.parametrize("enough", [0.02, 0.3, 0.6])
def test_gaps_are_filled_until_as_much_is_covered_as_is_enough(enough):
    mask = disc(150)
    places = [each.ravel() for each in np.meshgrid(np.arange(100.0, 400, 4), -np.arange(100.0, 400, 4))]
    twigs = np.column_stack([*places, np.zeros(len(places[0]))])
    settings = LeafFillSettings(enough=enough)
    nothing = np.zeros_like(mask)
    filled = fill_gaps(nothing, mask, mask, twigs, 20.0, 0.5, 10_000, np.random.default_rng(0), settings)
    across = filled.along[:, :2] * 20.0
    covered = np.zeros(mask.shape, np.uint8)
    side = 0.5 * 0.5 * np.column_stack([-across[:, 1], across[:, 0]])
    start = filled.base[:, :2]
    for corners in np.stack([start, start + across / 2 + side, start + across, start + across / 2 - side], axis=1):
        cv2.fillConvexPoly(covered, np.round(corners * [1, -1]).astype(np.int32), 1)
    assert (covered[mask] == 0).mean() == pytest.approx(enough, abs=0.12)


def test_a_crown_from_the_side_is_as_deep_as_its_space():
    mask = disc(150)
    bounds = bound_crown(mask)
    side = view_from_the_side(bounds)
    assert side.inside.sum() == pytest.approx(2 * bounds.half_depth.max(axis=1).sum(), rel=0.03)
    assert (side.inside.any(axis=1) == mask.any(axis=1)).mean() > 0.99
    front = np.array([250.0, -250.0, bounds.half_depth.max(), 1.0])
    seen = side.from_picture @ front
    assert np.allclose(np.linalg.det(side.from_picture[:3, :3]), 1)
    assert seen[0] == pytest.approx(np.flatnonzero(side.inside.any(axis=0))[0], abs=2)  # the viewer stands at the left
    assert seen[1] == front[1]
    assert abs(seen[2]) < 1.0


def test_a_bare_tree_fills_its_stroke():
    twigs = np.zeros((SIZE, SIZE), bool)
    twigs[100:400, 248:252] = twigs[200:203, 120:380] = True
    drawn = disc(160)
    alone, whole = bound_crown(twigs), bound_crown(twigs, drawn=drawn)
    assert whole.inside.sum() > 2 * alone.inside.sum()
    assert not (whole.inside & ~drawn & ~alone.inside).any()
    assert whole.half_depth.max() == pytest.approx(150, rel=0.15)


def test_only_the_top_of_a_clear_proposal_is_completed():
    """A spire before the sky stands above the proposal; what is beside its lower part is not added."""
    srgb = np.full((300, 300, 3), (120, 170, 230), np.uint8)
    srgb[260:] = (120, 110, 60)
    tree = np.zeros((300, 300), bool)
    tree[120:250, 90:210] = True
    tree[60:120, 140:160] = True
    srgb[tree] = (50, 90, 40)
    proposal = tree.copy()
    proposal[:120] = False  # without its spire
    proposal[:, :130] = False  # and without its left part
    completed = complete_proposal(proposal, srgb, find_sky(srgb, 0), only_top=True)
    assert completed[80:120, 142:158].mean() > 0.9
    np.testing.assert_array_equal(completed[160:], proposal[160:])
    assert complete_proposal(proposal, srgb, find_sky(srgb, 0))[160:240, 100:130].mean() > 0.9
