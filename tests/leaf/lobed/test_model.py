"""A lobed leaf from its mask: shapes whose skeleton is known."""

import cv2
import numpy as np
import pytest
from usdfoliage.leaf.lobed.model import model_lobed_leaf


def drawn_leaf(lobes: int, size: int = 400) -> np.ndarray:
    """A mask of round lobes around a middle, with a petiole below."""
    mask = np.zeros((size, size), np.uint8)
    middle = np.array([size / 2, size / 2])
    cv2.circle(mask, tuple(middle.astype(int)), size // 8, 1, cv2.FILLED)
    for angle in np.radians(np.linspace(-20, 200, lobes)):
        tip = middle + 0.36 * size * np.array([np.cos(angle), -np.sin(angle)])
        cv2.line(mask, tuple(middle.astype(int)), tuple(tip.astype(int)), 1, size // 10)
    cv2.line(mask, tuple(middle.astype(int)), (size // 2, int(0.95 * size)), 1, max(3, size // 60))
    return mask.astype(bool)


def covered(leaf, mask: np.ndarray) -> np.ndarray:
    """(H, W) what the faces of a leaf cover."""
    cover = np.zeros(mask.shape, np.uint8)
    for corners in (leaf.ties.places() * [1, -1])[leaf.ties.quads()]:
        cv2.fillPoly(cover, [np.round((corners - 0.5) * 16).astype(np.int32)], 1, shift=4)
    return cover > 0


@pytest.mark.parametrize("lobes", [2, 3, 5])
def test_each_lobe_has_a_branch_and_the_faces_cover_the_leaf(lobes):
    mask = drawn_leaf(lobes)
    leaf = model_lobed_leaf(mask)
    assert leaf.lobes == lobes
    cover = covered(leaf, mask)
    assert (cover & mask).sum() / (cover | mask).sum() > 0.97
    assert (leaf.ties.areas() > 0).all()
    assert leaf.ties.places()[leaf.ties.base, 1] < -0.9 * 400  # the end of the petiole


def test_a_turned_leaf_has_the_same_skeleton():
    mask = drawn_leaf(5)
    turned = model_lobed_leaf(mask[:, ::-1])
    assert turned.lobes == model_lobed_leaf(mask).lobes


def test_noise_on_the_outline_makes_no_branch():
    mask = drawn_leaf(3)
    rng = np.random.default_rng(0)
    rough = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 2) + 0.15 * rng.normal(size=mask.shape) > 0.5
    assert (rough != mask).sum() > 500
    assert model_lobed_leaf(rough).lobes == 3


def test_each_edge_of_the_skeleton_has_a_face_on_either_side():
    quads = model_lobed_leaf(drawn_leaf(3)).ties.quads()
    edges = np.concatenate([np.roll(quads, -side, axis=1)[:, :2] for side in range(4)])
    _, count = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    assert (count <= 2).all()
    outline = (np.sort(edges, axis=1).min(axis=1) >= quads[:, 0].max() + 1).sum()
    assert (count == 1).sum() == outline  # nothing but the outline is open


def test_an_empty_mask_is_refused():
    with pytest.raises(ValueError, match="shows no leaf"):
        model_lobed_leaf(np.zeros((20, 20), bool))
