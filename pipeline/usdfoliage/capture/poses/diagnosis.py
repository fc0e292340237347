"""What is reported of estimated poses: why photographs have no camera, and why cameras may be wrong."""

import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.folder.listing import counted, named
from usdfoliage.capture.folder.photo_set import PhotoFile, PhotoSet
from usdfoliage.capture.poses.result import PairMatches, RegisteredPhoto, Unregistered
from usdfoliage.remarks import Remark, Setting, remark

_STILL_SHARE = 0.35  # of matches that fit; fewer where things move, or repeat
_FOCAL_SHARES = (0.35, 8.0)  # of the longer side: what cameras that photograph plants have
_MIN_SPREAD = 0.04  # of the longer side: standard deviation of points across the band that they lie in


def list_failures(
    photo_set: PhotoSet,
    features: Sequence[Path],
    group: NDArray[np.int64],
    found: PairMatches,
    failed: dict[int, str],
    min_matches: int,
    used: NDArray[np.int64] | None = None,
) -> tuple[Unregistered, ...]:
    """Each photograph without a camera, those left out of the set among them, with the likely reason.

    Of used pairs (P, 2), where others contradicted them, the reason gives how many of the photograph's pairs did.
    """
    photos = photo_set.photos
    in_group = np.flatnonzero(group == 0)
    blurred = set(photo_set.blurred)
    failures = [Unregistered(name=item.name, reason=item.reason) for item in photo_set.dropped]
    for index, photo in enumerate(photos):
        if group[index] == 0:
            continue
        if index in failed:
            reason = f"its features could not be found: {failed[index]}"
        else:
            with np.load(features[index], allow_pickle=False) as arrays:
                count = len(arrays["keypoints"])
            others = found.verified[index] >= min_matches
            to_group = int(found.verified[index, in_group].max())
            turned = others & found.panoramic[index]
            hint = "; it is blurred" if photo.name in blurred else ""
            if count < 4 * min_matches:
                reason = f"only {counted(count, 'feature')} in it: it shows too little, or nothing sharp{hint}"
            elif group[index] > 0:
                size = int((group == group[index]).sum())
                reason = f"left in a smaller group of {counted(size, 'photograph')} that does not join the others{hint}"
            elif not others.any():
                best = int(found.verified[index].max())
                reason = (
                    f"at most {counted(best, 'feature')} in common with any other photograph, "
                    f"{min_matches} are needed: perhaps another scene, or too far from the next{hint}"
                )
            elif to_group < min_matches:
                reason = f"it overlaps only photographs that have no camera either{hint}"
            elif used is not None and np.count_nonzero(used == index) < np.count_nonzero(others):
                pairs = counted(int(np.count_nonzero(others)), "pair")
                contradicting = int(np.count_nonzero(others) - np.count_nonzero(used == index))
                reason = f"{contradicting} of its {pairs} contradict those of the other photographs{hint}"
            elif bool((turned == others).all()):
                reason = f"the camera only turned between it and the others, and did not move{hint}"
            else:
                reason = (
                    f"{to_group} features in common with the best of the others, too few of them on points that have "
                    f"a place{hint}"
                )
        failures.append(Unregistered(name=photo.name, reason=reason))
    return tuple(sorted(failures, key=lambda failure: failure.name))


def describe_poses(
    photos: Sequence[PhotoFile],
    images: NDArray[np.int64],
    found: PairMatches,
    registered: Sequence[RegisteredPhoto],
    min_matches: int,
) -> tuple[Remark, ...]:
    """Remarks on photographs without a camera, on matches that fit no motion, and on several cameras."""
    remarks = []
    if len(images) < len(photos):
        missing = sorted({photo.name for photo in photos} - {photo.name for photo in registered})
        text = f"{len(missing)} of {counted(len(photos), 'photograph')} have no camera: {named(missing)}"
        remarks.append(remark("photographs-not-registered", text, subject=named(missing)))
    inside = np.ix_(images, images)
    looked_at = found.verified[inside] >= min_matches
    if looked_at.any():
        share = float(np.median(found.verified[inside][looked_at] / np.maximum(found.similar[inside][looked_at], 1)))
        if share < _STILL_SHARE:
            text = (
                f"only {share:.0%} of what looks the same in two photographs fits one motion of the camera; "
                f"leaves may have moved in the wind between them, or much repeats"
            )
            remarks.append(remark("matches-fit-no-motion", text))
    models = Counter(photo.lens for photo in registered)
    if len(models) > 1 and len(models) < len(registered):
        text = f"{len(models)} cameras took {counted(len(registered), 'photograph')}"
        remarks.append(remark("several-cameras", text))
    return tuple(remarks)


def check_cameras(
    registered: Sequence[RegisteredPhoto],
    track_photos: NDArray[np.int64],
    places_px: NDArray[np.float64],
    min_matches: int,
) -> tuple[Remark, ...]:
    """Warnings by which the cameras are probably wrong, however well the points fit them."""
    remarks = []
    focal = {round(photo.lens.focal_px[0] / max(photo.lens.width_px, photo.lens.height_px), 3) for photo in registered}
    odd = [share for share in focal if not _FOCAL_SHARES[0] <= share <= _FOCAL_SHARES[1]]
    if odd:
        text = f"a focal length of {odd[0]:g} of the longer side is improbable"
        key = Setting(name="capture.pose_estimation.focal_px")
        remarks.append(remark("focal-length-improbable", text, remedy=("give ", key)))
    sparse = [photo.name for photo in registered if photo.points < 4 * min_matches]
    if len(sparse) > len(registered) / 2:
        text = f"{len(sparse)} of {counted(len(registered), 'photograph')} see fewer than {4 * min_matches} points"
        remedy = "take more photographs, nearer to each other"
        remarks.append(remark("few-points-seen", text, subject=named(sparse), remedy=remedy))
    narrow = []
    for number, photo in enumerate(registered):
        places = places_px[track_photos == number]
        if len(places) > 2:
            thin = math.sqrt(max(float(np.linalg.eigvalsh(np.cov(places.T))[0]), 0))
            narrow.append(thin / max(photo.lens.width_px, photo.lens.height_px))
    if narrow and float(np.median(narrow)) < _MIN_SPREAD:
        text = (
            f"the points of most photographs lie in a band {float(np.median(narrow)):.1%} of the longer side wide, as "
            f"of a horizon behind the plant, which does not determine the cameras"
        )
        remedy = (
            "put something textured around the plant, take photographs nearer to each other, or give the poses in "
            "cameras/"
        )
        remarks.append(remark("points-in-a-band", text, remedy=remedy))
    return tuple(remarks)
