"""Small captures of known leaves, made once a session."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from usdfoliage.capture.view import View
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.jitter import spread_phases

from tools.bench.leaf_truth import TrueLeaves, true_leaves, visible_shares
from tools.synthetic.scene import SceneSettings
from tools.synthetic_foliage import CaptureSettings, SyntheticCapture, make_capture


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownFoliage:
    """A capture in memory and what is true of it."""

    views: Sequence[View]  # with exact depth
    noisy_views: Sequence[View]
    truth: TrueLeaves
    visible: NDArray[np.float64]  # (N,), share of each leaf that its best view shows
    leaves: Leaves  # the true ones, exactly
    leaf_ids: Sequence[NDArray[np.uint16]]  # (H, W) a view, 0 for none, k for the leaf k - 1
    capture: SyntheticCapture


@cache
def known_foliage(
    leaves: int = 40,
    views: int = 4,
    size: tuple[int, int] = (480, 360),
    seed: int = 0,
    length_m: float = 0.07,
    up_axis: str = "Y",
) -> KnownFoliage:
    """A bed of leaves in front of a wall, seen from an arc; some seconds the first time."""
    scene = SceneSettings(leaves=leaves, views=views, width_px=size[0], height_px=size[1], seed=seed, length_m=length_m)
    capture = make_capture(CaptureSettings(scene=scene, up_axis=up_axis))
    truth = true_leaves(capture.truth)
    seen = [(view.camera, view.depth_m) for view in capture.views]
    return KnownFoliage(
        views=capture.views,
        noisy_views=capture.noisy_views(),
        truth=truth,
        visible=visible_shares(truth, seen).max(axis=1),
        leaves=exact_leaves(capture.truth),
        leaf_ids=[view.leaf_id for view in capture.seen],
        capture=capture,
    )


def exact_leaves(truth: Mapping[str, NDArray[np.generic]]) -> Leaves:
    """The leaves whose parameters a synthetic truth/leaves.npz holds, in the capture's frame."""
    return Leaves(
        parameters=np.asarray(truth["parameters"], np.float64),
        base_m=np.asarray(truth["base"], np.float64),
        orientation=np.asarray(truth["orientation"], np.float64),
        length_m=np.asarray(truth["chord"], np.float64),
        phase=spread_phases(len(truth["chord"])),
    )
