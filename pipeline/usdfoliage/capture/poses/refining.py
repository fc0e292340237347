"""Cameras that few features support, refined: photographs are matched again along epipolar lines, and all adjusted."""

import logging
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.poses.child_process import run_items
from usdfoliage.capture.poses.mapping import MatchedPhotos, Model, drop_unseeing
from usdfoliage.capture.poses.settings import PoseEstimationSettings, name_of
from usdfoliage.files.npz import read_arrays
from usdfoliage.progress import Progress

logger = logging.getLogger(__name__)

_FEW_POINTS = 500  # that a photograph sees in the median, below which refining moved cameras of our captures nearer
_FOCAL_CHANGE = 0.1  # share of the focal length, from which an adjusted one is wrong
_WIDEST_DEG = 70.0  # between the directions from which two photographs see the plant
_COMPANIONS = 10  # photographs that each is matched with, the nearest in direction
_ROUNDS = ((6.0, 4.0), (3.0, 2.0))  # pixels: from the epipolar line, and of a point from where it is seen


def refine_cameras(
    matched: MatchedPhotos,
    model: Model,
    work: Path,
    settings: PoseEstimationSettings,
    processes: int,
    progress: Progress | None = None,
) -> Model:
    """The model, with cameras adjusted to features that match along the epipolar lines of its cameras.

    Where few features of a photograph differ from all its others, as on a plant before a plain wall or between walls
    that look the same, cameras are only about right. Near a line a feature has few rivals, and many more match.

    Args:
        matched: The photographs.
        model: Cameras and points that were found.
        work: The folder for matches and models; what is there already is not done again.
        settings: How cameras are found.
        processes: How many child processes run at once, at most.
        progress: Called with photographs matched.

    Returns:
        The given model where its photographs see enough points; otherwise that of the last round that neither failed,
        nor lost a photograph or points, nor changed a focal length by a tenth.
    """
    seen = np.bincount(model["track"][:, 0], minlength=len(matched.features))[model["images"]]
    if len(seen) < 3 or np.median(seen) >= _FEW_POINTS:
        return model
    for line_px, error_px in _ROUNDS:
        refined = _refine_once(matched, model, line_px, error_px, work, settings, processes, progress)
        if refined is None or len(refined["points"]) < len(model["points"]):
            return model
        change = np.abs(refined["parameters"][:, 0] / model["parameters"][:, 0] - 1)
        if not change.max() < _FOCAL_CHANGE:
            logger.info("cameras are not refined: a focal length would change by %.0f %%", 100 * change.max())
            return model
        model = refined
    return model


def _refine_once(
    matched: MatchedPhotos,
    model: Model,
    line_px: float,
    error_px: float,
    work: Path,
    settings: PoseEstimationSettings,
    processes: int,
    progress: Progress | None,
) -> Model | None:
    """Matches along lines, and all adjusted; None where it failed."""
    images = [int(image) for image in model["images"]]
    features = [matched.features[image] for image in images]
    cameras = [
        {**matched.cameras[image], "parameters": [float(value) for value in model["parameters"][place]]}
        for place, image in enumerate(images)
    ]
    known = {
        "features": [str(file.resolve()) for file in features],
        "cameras": cameras,
        "cam_from_world": model["cam_from_world"].tolist(),
    }
    job = {"task": "match-again", "max_line_px": line_px}
    made_from = name_of(job, cameras, known["cam_from_world"], [file.name for file in features])
    items = []
    for first, others in _companions(model["cam_from_world"], model["points"]).items():
        out = work / f"again-{name_of(made_from, first, others)}.npz"
        items.append({"first": first, "seconds": others, "out": str(out)})
    failures = run_items({**job, **known}, items, work, processes, progress)
    for failure in failures:
        logger.warning("photograph %d is not matched again: %s", items[failure.number]["first"], failure.reason)
    lost = {failure.number for failure in failures}
    files = [str(item["out"]) for number, item in enumerate(items) if number not in lost]
    job = {
        "task": "adjust", "seed": settings.seed, "min_matches": settings.min_matches, "mapper_threads": 1,
        "max_error_px": error_px,
    }  # fmt: skip
    out = work / f"adjusted-{name_of(job, made_from, [Path(file).name for file in files])}.npz"
    request = {**job, **known, "numbers": list(range(len(images))), "matches": files}
    failures = run_items(request, [{"out": str(out)}], work, 1)
    if failures:
        logger.warning("cameras are not refined: %s", failures[0].reason)
        return None
    refined = dict(read_arrays(out))
    if not np.array_equal(refined["images"], np.arange(len(images))):
        return None  # a photograph was lost
    order = model["images"]
    refined["images"] = order
    refined["track"] = np.column_stack([order[refined["track"][:, 0]], refined["track"][:, 1]])
    refined["group"] = model["group"]
    seeing = drop_unseeing(refined, settings.min_matches)
    return refined if len(seeing["images"]) == len(images) else None


def _companions(cam_from_world: NDArray[np.float64], points: NDArray[np.float64]) -> dict[int, list[int]]:
    """For each photograph those after it that it is matched with: places in the model."""
    centers = -np.einsum("nji,nj->ni", cam_from_world[:, :, :3], cam_from_world[:, :, 3])
    toward = np.median(points, axis=0) - centers
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    near = toward @ toward.T
    order = np.argsort(-near, axis=1, kind="stable")
    lowest = np.cos(np.radians(_WIDEST_DEG))
    wanted: set[tuple[int, int]] = set()
    for first, row in enumerate(order):
        others = [int(other) for other in row if other != first and near[first, other] > lowest]
        wanted |= {(min(first, other), max(first, other)) for other in others[:_COMPANIONS]}
    companions: dict[int, list[int]] = {}
    for first, second in sorted(wanted):
        companions.setdefault(first, []).append(second)
    return companions
