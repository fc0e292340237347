"""Candidate leaves of a single photograph, by colour and edges alone: coarse.

Without depth there is no plane and no distance; what remains of section 4.1 is the superpixel graph with an affinity.
Two neighbours belong together as far as their colours agree and no edge runs along the boundary they share. Instead
of thresholding the affinity, regions are merged from the least step on, each as far as its own variation allows (P.
Felzenszwalb, D. Huttenlocher, Efficient Graph-Based Image Segmentation, 2004), so that a leaf with veins and a plain
one may both stay whole. Leaves of one colour that overlap without a visible edge are joined, veins and patches of
sunlight part a leaf.
"""

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.enclosing_ellipse import enclosing_ellipses
from usdfoliage.leaf.segmentation.model import Candidates
from usdfoliage.leaf.segmentation.paper.superpixels import SuperpixelSettings, segment_superpixels


@dataclass(frozen=True, kw_only=True)
class PictureSettings:
    """When superpixels of a photograph belong together."""

    superpixels: SuperpixelSettings = field(default_factory=SuperpixelSettings)
    tolerance: float = 40.0  # Lab units times superpixels: small regions merge this willingly
    edge_weight: float = 1.0  # of the gradient along a shared boundary, beside the difference of colour
    chroma_weight: float = 1.5  # of a and b beside L: light varies within a leaf more than hue
    min_superpixels: int = 4
    max_share: float = 0.25  # of the picture
    min_confidence: float = 0.45  # share of its enclosing ellipse that a candidate occupies

    def __post_init__(self) -> None:
        if min(self.tolerance, self.edge_weight, self.chroma_weight) < 0 or self.min_superpixels < 1:
            raise ValueError(f"tolerance and weights must not be below 0, min_superpixels not below 1: {self}")
        if not 0 < self.max_share <= 1 or not 0 <= self.min_confidence <= 1:
            raise ValueError(f"max_share must be in (0, 1] and min_confidence in [0, 1], not {self}")


def segment_picture(
    srgb: NDArray[np.uint8],
    settings: PictureSettings = PictureSettings(),
    *,
    mask: NDArray[np.bool_] | None = None,
) -> Candidates:
    """Candidate leaves of a photograph without depth.

    Args:
        srgb: (H, W, 3), red, green, blue, encoded for display.
        settings: When superpixels belong together.
        mask: (H, W), True on the plant; everywhere if None.

    Raises:
        ValueError: The arrays are not of these shapes.
    """
    labels = segment_superpixels(srgb, mask, settings.superpixels)
    count = int(labels.max(initial=-1)) + 1
    lab = cv2.cvtColor(srgb.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    lab[..., 1:] *= settings.chroma_weight
    edges, step = _steps(lab, labels, count, settings.edge_weight)
    component = _fill_holes(_merge(count, edges, step, settings.tolerance), edges, settings.min_superpixels)

    total = int(component.max(initial=-1)) + 1
    grains = np.bincount(component, minlength=total)
    owner_map = np.append(component, -1)[labels]
    pixels = np.bincount(owner_map[owner_map >= 0], minlength=total)
    confidence = _confidence(owner_map, total)
    kept = (grains >= settings.min_superpixels) & (pixels <= settings.max_share * labels.size)
    kept &= confidence >= settings.min_confidence
    number = np.append(np.where(kept, np.cumsum(kept), 0), 0).astype(np.int32)
    return Candidates(labels=number[owner_map], confidence=confidence[kept], superpixels=labels)


def _steps(
    lab: NDArray[np.float32], labels: NDArray[np.int32], count: int, edge_weight: float
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Neighbours (E, 2), and how far apart their colours are and how strong the edge between them is."""
    smooth = cv2.GaussianBlur(lab, (0, 0), 1.0)
    gradient = np.sqrt(
        np.sum(cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=0.125) ** 2, axis=2)
        + np.sum(cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=0.125) ** 2, axis=2)
    ).astype(np.float64)
    known = labels.ravel() >= 0
    sizes = np.maximum(np.bincount(labels.ravel()[known], minlength=count), 1)
    color = np.stack(
        [np.bincount(labels.ravel()[known], lab[..., k].ravel()[known], minlength=count) / sizes for k in range(3)],
        axis=1,
    )
    inside = np.bincount(labels.ravel()[known], gradient.ravel()[known], minlength=count) / sizes
    keys, strength = [], []
    for here, there in (
        (np.s_[:, :-1], np.s_[:, 1:]),
        (np.s_[:-1], np.s_[1:]),
    ):
        one, other = labels[here], labels[there]
        border = (one != other) & (one >= 0) & (other >= 0)
        low, high = np.minimum(one, other)[border].astype(np.int64), np.maximum(one, other)[border]
        keys.append(low * count + high)
        strength.append(np.maximum(gradient[here], gradient[there])[border])
    key, place = np.unique(np.concatenate(keys), return_inverse=True)
    low, high = key // max(count, 1), key % max(count, 1)
    along = np.bincount(place, np.concatenate(strength), minlength=len(key)) / np.bincount(place, minlength=len(key))
    # An edge counts as far as it is stronger than what both superpixels are full of anyhow.
    edge = np.maximum(along - np.maximum(inside[low], inside[high]), 0)
    return np.column_stack([low, high]), np.linalg.norm(color[low] - color[high], axis=1) + edge_weight * edge


def _merge(count: int, edges: NDArray[np.intp], step: NDArray[np.float64], tolerance: float) -> NDArray[np.intp]:
    """(S,): the region of each superpixel, from 0."""
    parent, size, within = list(range(count)), [1] * count, [0.0] * count

    def root(node: int) -> int:
        while parent[node] != node:
            parent[node] = parent[parent[node]]
            node = parent[node]
        return node

    order = np.argsort(step, kind="stable")
    for (one, other), gap in zip(edges[order].tolist(), step[order].tolist(), strict=True):
        a, b = root(one), root(other)
        if a != b and gap <= min(within[a] + tolerance / size[a], within[b] + tolerance / size[b]):
            a, b = min(a, b), max(a, b)
            parent[b], size[a], within[a] = a, size[a] + size[b], gap
    _, component = np.unique([root(node) for node in range(count)], return_inverse=True)
    return np.asarray(component, np.intp)


def _fill_holes(component: NDArray[np.intp], edges: NDArray[np.intp], smaller_than: int) -> NDArray[np.intp]:
    """(S,): small regions that have a single neighbour given to it; numbered anew."""
    pairs = component[edges]
    pairs = np.unique(np.concatenate([pairs, pairs[:, ::-1]])[np.tile(pairs[:, 0] != pairs[:, 1], 2)], axis=0)
    total = int(component.max(initial=-1)) + 1
    neighbors = np.bincount(pairs[:, 0], minlength=total)
    target = np.arange(total)
    lone = (neighbors == 1) & (np.bincount(component, minlength=total) < smaller_than)
    inside = lone[pairs[:, 0]] & ~lone[pairs[:, 1]]
    target[pairs[inside, 0]] = pairs[inside, 1]
    _, component = np.unique(target[component], return_inverse=True)
    return np.asarray(component, np.intp)


def _confidence(owner_map: NDArray[np.intp], count: int) -> NDArray[np.float64]:
    """(C,): the share of its enclosing ellipse in the picture that each region occupies."""
    order = np.flatnonzero(owner_map.ravel() >= 0)
    order = order[np.argsort(owner_map.ravel()[order], kind="stable")]
    pixels = np.bincount(owner_map.ravel()[order], minlength=count)
    places = np.column_stack([order % owner_map.shape[1], order // owner_map.shape[1]]).astype(np.float64)
    ellipses = enclosing_ellipses(places, np.concatenate([[0], np.cumsum(pixels)]), tolerance=1e-3)
    area = np.pi * np.prod(ellipses.half_axes + 0.5, axis=1)  # to the borders of pixels, not to their middles
    return np.asarray(np.minimum(pixels / area, 1.0))
