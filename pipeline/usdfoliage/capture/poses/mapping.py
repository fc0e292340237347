"""Cameras and points of photographs whose features are matched, without pairs that repeated surfaces mislead."""

import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from usdfoliage.capture.folder.listing import counted
from usdfoliage.capture.folder.photo_set import PhotoSet
from usdfoliage.capture.poses.child_process import run_items
from usdfoliage.capture.poses.result import PairMatches
from usdfoliage.capture.poses.settings import PoseEstimationSettings, name_of
from usdfoliage.capture.poses.view_graph import PairTurns, ViewGraphSettings, average_turns
from usdfoliage.errors import CaptureError
from usdfoliage.files.npz import read_arrays
from usdfoliage.progress import Progress
from usdfoliage.remarks import Remark, remark

logger = logging.getLogger(__name__)

# What the worker packs; photographs are numbered as in the set. With pairs (P, 2) where some contradicted the others:
# those that were used.
Model = dict[str, NDArray[Any]]

_MIN_MODEL = 2  # photographs
_MIN_RING = 6  # photographs, from which pairs can contradict each other
_MIN_CONTRADICTING = 0.15  # share of the pairs, from which surfaces may repeat
_MIN_IN_ORDER = 0.8  # of photographs that match the next one, from which they were taken in order
_TURN_OFF_DEG = 2.0  # from which a pair contradicts a model
_ALL_BUT_A_FEW = 0.95  # of the pairs that agree
_ALLOWED = 2.0  # times the limit of pairs that agree: they are chosen from once more, by their features
_MIN_KEPT = 0.9  # of the photographs that all pairs place


@dataclass(frozen=True, kw_only=True, eq=False)
class MatchedPhotos:
    """Photographs, and files with their features and matches."""

    photo_set: PhotoSet
    features: tuple[Path, ...]  # of every photograph
    cameras: dict[int, dict[str, Any]]  # of those in usable: what COLMAP is given
    usable: tuple[int, ...]  # photographs with features
    match_files: tuple[Path, ...]
    pairs: PairMatches
    only: tuple[tuple[int, int], ...] | None = None  # pairs that are used; None for all


def map_photos(
    matched: MatchedPhotos,
    work: Path,
    settings: PoseEstimationSettings,
    processes: int,
    progress: Progress | None = None,
) -> tuple[Model, tuple[Remark, ...]]:
    """The cameras and points of the largest group of photographs, and a remark where pairs contradicted each other.

    Surfaces that repeat, as equal walls, give pairs with many matches and a wrong motion. The lens of a wrong model is
    nearly right nevertheless; with it, how the camera turned between two photographs is known, and which pairs agree.
    Where many do not, cameras are found again by those that do, and kept if more of those pairs agree with them.

    Args:
        matched: The photographs.
        work: The folder for models; what is there already is not done again.
        settings: How.
        processes: How many child processes run at once, at most.
        progress: Called with photographs placed.

    Raises:
        CaptureError: No two photographs overlap; the camera did not move; nothing starts a reconstruction.
    """
    model = _map(matched, work, settings, progress)
    usable = np.asarray(matched.usable, np.int64)
    following = matched.pairs.verified[usable, np.roll(usable, -1)] >= settings.min_matches
    if len(usable) < _MIN_RING or following.mean() < _MIN_IN_ORDER:
        return model, ()
    pairs, turns = _find_turns(matched, model, work, settings, processes)
    agreement = average_turns(turns, len(usable))
    loose_rad = float(np.radians(ViewGraphSettings().consistent_deg))
    if agreement is None or np.mean(agreement.off_rad >= loose_rad) < _MIN_CONTRADICTING:
        return model, ()
    precise = agreement.off_rad < agreement.limit_rad
    fewest = 1 + _count_agreeing(model, pairs[precise], turns.turn[precise])
    if fewest > _ALL_BUT_A_FEW * np.count_nonzero(precise):  # what contradicts the others did not mislead the mapper
        return model, ()
    # The wider limit where too few pairs agree precisely.
    for limit_rad in (min(_ALLOWED * agreement.limit_rad, loose_rad), loose_rad):
        agree = agreement.off_rad < limit_rad
        try:
            other = _map(replace(matched, only=_as_pairs(pairs[agree])), work, settings, progress)
        except CaptureError:  # too few pairs are left
            continue
        enough = len(other["images"]) >= _MIN_KEPT * len(model["images"])
        if not enough or _count_agreeing(other, pairs[precise], turns.turn[precise]) < fewest:
            continue
        text = (
            f"{int(np.count_nonzero(~agree))} of {counted(len(agree), 'pair')} of photographs contradict the others, "
            f"as walls or tiles that look the same make them; they are not used"
        )
        return {**other, "pairs": pairs[agree]}, (remark("pairs-contradict", text),)
    return model, ()


def drop_unseeing(model: Model, min_points: int) -> Model:
    """The model without photographs that see fewer points: nothing determines their cameras."""
    while True:
        seen = np.bincount(model["track"][:, 0], minlength=int(model["images"].max(initial=0)) + 1)[model["images"]]
        if (seen >= min_points).all():
            return model
        keep, dropped = seen >= min_points, model["images"][seen < min_points]
        starts, track = model["track_starts"], model["track"]
        point_of = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
        stays = ~np.isin(track[:, 0], dropped)
        views = np.bincount(point_of[stays], minlength=len(starts) - 1)
        whole = views >= 2  # photographs, without which a point is none
        stays &= whole[point_of]
        group = model["group"].copy()
        group[dropped] = -1
        model = {
            **model,
            **{name: model[name][keep] for name in ("images", "cam_from_world", "parameters")},
            "points": model["points"][whole],
            "errors": model["errors"][whole],
            "track_starts": np.concatenate([[0], np.cumsum(views[whole])]).astype(np.int64),
            "track": track[stays],
            "group": group,
        }


def _as_pairs(numbers: NDArray[np.int64]) -> tuple[tuple[int, int], ...]:
    return tuple((int(first), int(second)) for first, second in numbers)


def _count_agreeing(model: Model, pairs: NDArray[np.int64], turn: NDArray[np.float64]) -> int:
    """How many pairs (P, 2) of photographs turned (P, 3, 3) as the cameras of a model have it."""
    inside = np.isin(pairs, model["images"]).all(axis=1)
    place = np.searchsorted(model["images"], pairs[inside])
    cameras = Rotation.from_matrix(model["cam_from_world"][:, :, :3])
    between = cameras[place[:, 1]] * cameras[place[:, 0]].inv()
    differ = (Rotation.from_matrix(turn[inside]).inv() * between).magnitude()
    return int(np.count_nonzero(differ < np.radians(_TURN_OFF_DEG)))


def _find_turns(
    matched: MatchedPhotos, model: Model, work: Path, settings: PoseEstimationSettings, processes: int
) -> tuple[NDArray[np.int64], PairTurns]:
    """Pairs (P, 2), and how the camera turned in each, by the lenses of a model; photographs as in usable there."""
    place = {int(photo): k for k, photo in enumerate(model["images"])}
    sides_px = {index: max(camera["width_px"], camera["height_px"]) for index, camera in matched.cameras.items()}
    focal = float(np.median([model["parameters"][at, 0] / sides_px[index] for index, at in place.items()]))
    cameras = []
    for index in range(len(matched.features)):
        camera = matched.cameras.get(index)
        if camera is not None and index in place:
            camera = {**camera, "parameters": model["parameters"][place[index]].tolist(), "known": True}
        elif camera is not None:
            camera = {**camera, "focal_px": focal * sides_px[index], "known": True}
        cameras.append(camera)
    job = {"task": "turns", "seed": settings.seed, "min_matches": settings.min_matches}
    items = [
        {"matches": str(file.resolve()), "out": str(work / f"turns-{name_of(job, cameras, file.name)}.npz")}
        for file in matched.match_files
    ]
    request = {**job, "features": [str(file.resolve()) for file in matched.features], "cameras": cameras}
    failures = run_items(request, items, work, processes)
    lost = {failure.number for failure in failures}
    for failure in failures:
        logger.warning("turns of %s are lost: %s", matched.match_files[failure.number].name, failure.reason)
    parts = [read_arrays(Path(item["out"])) for number, item in enumerate(items) if number not in lost]
    empty = {"pairs": np.zeros((0, 2), np.int64), "turn": np.zeros((0, 3, 3)), "matches": np.zeros(0)}
    joined = {name: np.concatenate([none, *(part[name] for part in parts)]) for name, none in empty.items()}
    order = np.full(len(matched.features), -1, np.int64)
    order[list(matched.usable)] = np.arange(len(matched.usable))
    first, second = order[joined["pairs"]].T
    return joined["pairs"], PairTurns(first=first, second=second, turn=joined["turn"], matches=joined["matches"])


def _map(matched: MatchedPhotos, work: Path, settings: PoseEstimationSettings, progress: Progress | None) -> Model:
    """The model of the worker."""
    photo_set, features, usable, found = matched.photo_set, matched.features, matched.usable, matched.pairs
    overlapping = found.verified >= settings.min_matches
    if not overlapping.any():
        raise CaptureError(
            f"no two of {counted(len(usable), 'photograph')} in {photo_set.folder} overlap: the best pair has "
            f"{int(found.verified.max())} features in common, {settings.min_matches} are needed",
            "photograph the plant from places 10 to 15 degrees apart, with something still and textured around it",
        )
    if bool((found.panoramic | ~overlapping).all()):
        raise CaptureError(
            f"the camera only turned between the photographs in {photo_set.folder} and did not move: no depth can be "
            f"seen so",
            "walk around the plant",
        )
    wanted = {"auto": ("incremental", "global")}.get(settings.mapper, (settings.mapper,))
    best: Model = {}
    for mapper in wanted:
        job = {
            "task": "map", "mapper": mapper, "seed": settings.seed, "min_matches": settings.min_matches,
            "mapper_threads": 1, "global_ratio": 1.2, "pairs": matched.only,
        }  # fmt: skip
        job |= {
            "features": [str(features[index].resolve()) for index in usable],
            "cameras": [matched.cameras[index] for index in usable],
            "numbers": list(usable),
            "matches": [str(file.resolve()) for file in matched.match_files],
        }
        made_from = [features[index].name for index in usable], [file.name for file in matched.match_files]
        out = work / f"model-{name_of({**job, 'features': '', 'matches': ''}, made_from)}.npz"
        failures = run_items(job, [{"out": str(out)}], work, 1, progress)
        if failures:
            logger.warning("the %s mapper failed: %s", mapper, failures[0].reason)
            continue
        with np.load(out, allow_pickle=False) as arrays:
            model = {name: arrays[name] for name in arrays.files}
        if len(model.get("images", ())) > len(best.get("images", ())):
            best = model
        if len(best.get("images", ())) >= 0.8 * len(usable):
            break
    if len(best.get("images", ())) < _MIN_MODEL:
        moved = overlapping & ~found.panoramic
        turned = int((overlapping & found.panoramic).sum() // 2)
        hint = (
            "most pairs show a camera that turned and did not move; walk around the plant"
            if turned > moved.sum() // 2
            else "take more photographs from places nearer to each other"
        )
        raise CaptureError(
            f"no cameras could be found for the photographs in {photo_set.folder}: "
            f"{counted(int(overlapping.sum() // 2), 'pair')} of them overlap, but none starts a reconstruction",
            hint,
        )
    order = np.asarray(usable, np.int64)
    best["images"] = order[best["images"]]
    best["track"] = np.column_stack([order[best["track"][:, 0]], best["track"][:, 1]])
    group = np.full(len(photo_set.photos), -1, np.int64)
    group[order] = best["group"]
    best["group"] = group
    return best
