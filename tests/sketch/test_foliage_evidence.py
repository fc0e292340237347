"""What looks like foliage, and what does not: drawn roads, walls and trees of all kinds."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from usdfoliage.branch.foliage.species import GENERIC, load_species
from usdfoliage.errors import FitError
from usdfoliage.sketch.foliage import find_foliage
from usdfoliage.sketch.foliage_evidence import measure_evidence
from usdfoliage.sketch.reconstruct import SketchSettings, sketch_tree
from usdfoliage.sketch.strokes import TreeStrokes

from tests.support.photographs.drawn_trees import draw_bare, draw_leafy
from tests.support.photographs.no_trees import bricks, noisy, road

ANGLE = np.linspace(0, 2 * np.pi, 40, endpoint=False)
OVER = TreeStrokes(
    crown_px=np.column_stack([150 + 90 * np.cos(ANGLE), 170 + 90 * np.sin(ANGLE)]),
    branches_px=(np.array([[150.0, 380], [150, 180]]),),
)


def tree(color: tuple[int, int, int], behind: tuple[int, int, int] = (190, 210, 240)) -> np.ndarray:
    """A crown of clumps of leaves of this colour, inside of the stroke."""
    rng = np.random.default_rng(2)
    picture = np.full((400, 300, 3), behind, float)
    cv2.line(picture, (150, 380), (150, 200), (90, 70, 55), 10)
    for turn, away in zip(rng.uniform(0, 2 * np.pi, 1500), rng.uniform(0, 1, 1500), strict=True):
        place = np.array([150, 170]) + 82 * np.sqrt(away) * np.array([np.cos(turn), np.sin(turn)])
        axes, tilt = (5, 3), float(rng.uniform(0, 360))
        shade = tuple(float(c * rng.uniform(0.55, 1.25)) for c in color)
        cv2.ellipse(picture, tuple(map(int, place)), axes, tilt, 0, 360, shade, -1)
    return noisy(picture, 4)


@pytest.mark.parametrize("picture", [road(), bricks()], ids=["road", "bricks"])
def test_a_stroke_over_what_has_no_foliage_is_refused(picture):
    with pytest.raises(FitError, match="no foliage") as caught:
        sketch_tree(picture, OVER, load_species(GENERIC))
    assert any("sketch.leaves" in str(part) for part in caught.value.remedy)


@pytest.mark.parametrize(
    "picture",
    [
        tree((60, 120, 40)),
        tree((215, 120, 40)),  # autumn
        tree((150, 40, 45)),
        tree((235, 190, 205)),  # blossom
        tree((120, 125, 120), (200, 200, 202)),  # grey leaves before a grey sky
        tree((60, 110, 45), (95, 125, 70)),  # before other trees
        tree((110, 112, 110), (150, 150, 150)),
        tree((30, 32, 30), (235, 200, 160)),  # nearly black, before the evening's sky
    ],
    ids=["green", "orange", "red", "blossom", "grey", "green on green", "grey on grey", "dark"],
)
def test_trees_of_all_colours_are_foliage(picture):
    for photo in (picture, cv2.cvtColor(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)):
        found = find_foliage(photo, OVER.crown_px, 0, branches_px=OVER.branches_px)
        if not found.mask.any():
            continue  # as bright as what is behind it: a crown without leaves, which is another error
        evidence = measure_evidence(photo, found.mask, found.before_sky, is_thin=found.is_thin)
        assert not evidence.is_none, evidence
        assert not evidence.is_little, evidence


@pytest.mark.parametrize("drawn", [draw_bare(), draw_leafy(), draw_leafy(120, 160)], ids=["bare", "leafy", "small"])
@pytest.mark.parametrize("grey", [False, True])
def test_drawn_trees_are_foliage(drawn, grey):
    photo = cv2.cvtColor(cv2.cvtColor(drawn.srgb, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB) if grey else drawn.srgb
    found = find_foliage(photo, drawn.strokes.crown_px, 0, branches_px=drawn.strokes.branches_px)
    evidence = measure_evidence(photo, found.mask, found.before_sky, is_thin=found.is_thin)
    assert not evidence.is_little, evidence


def test_a_bare_tree_before_a_wall_is_one():
    drawn = draw_bare()
    sky = np.abs(drawn.srgb.astype(int) - (190, 210, 240)).max(axis=2) < 25
    before = drawn.srgb.copy()
    before[sky] = noisy(np.full((*sky.shape, 3), (170, 168, 160)), 4)[sky]
    found = find_foliage(before, drawn.strokes.crown_px, 0, branches_px=drawn.strokes.branches_px)
    evidence = measure_evidence(before, found.mask, 0.0, is_thin=found.is_thin)
    assert not evidence.is_none, evidence


def test_who_asks_for_leaves_gets_them():
    settings = replace(SketchSettings(), require_foliage=False)
    assert sketch_tree(road(), OVER, load_species(GENERIC), settings).evidence.is_little


@pytest.mark.parametrize("pixels", [[(0, 0)], [(0, 0), (399, 299)], [(5, x) for x in range(300)]])
def test_few_pixels_are_measured_in_a_small_picture(pixels):
    mask = np.zeros((400, 300), bool)
    mask[tuple(np.transpose(pixels))] = True
    evidence = measure_evidence(road(), mask, 0.0, is_thin=True)
    assert np.isfinite([evidence.color, evidence.contrast, evidence.ruled]).all()
