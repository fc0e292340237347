"""The stems that photographs show and depth may have lost, for the task that traces branches."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.photographs.no_stems import NoStems
from usdfoliage.branch.photographs.reconstruct import FoundLeafPlaces, PhotographedStemSettings, reconstruct_stems
from usdfoliage.capture.cloud_files.ply import read_cloud
from usdfoliage.capture.folder.read import Capture, read_capture, read_views
from usdfoliage.errors import FoliageError
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.jobs.branches.known_stems import KnownStems
from usdfoliage.jobs.capture.results import CLOUD as CLOUD_FILE
from usdfoliage.jobs.plant.call import StageCall, fails_now
from usdfoliage.jobs.plant.stages.isolate import plant_capture, stand_height_m
from usdfoliage.jobs.plant.stages.models import read_captured_leaves
from usdfoliage.jobs.plant.tasks import LEAVES
from usdfoliage.leaf.change import move_leaves
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places
from usdfoliage.progress import progress_in_step
from usdfoliage.remarks import Remark, remark

_WITHIN = (0.002, 0.998)  # quantiles of the plant's points that its box is taken between: a few are far from it
_BESIDE = 0.03  # of the plant's larger side, that its box is wider
_ACROSS, _ALONG = 9, 17  # places at which a blade is known
_THICKER = 1.5  # times the widest line, that single stems of a herb are thicker
_OF_BASE = 0.15  # of a leaf's length from its base, up to which a line on it may be its petiole
_SURE = 0.8  # certainty of a base, below which the petiole may be at the other end


def try_photographed_stems(call: StageCall, failures: list[Remark], thickest_m: float) -> KnownStems | None:
    """As find_photographed_stems; where it fails or finds none, None: branches are those of the cloud.

    Args:
        call: Of the task.
        failures: A remark with the reason is added.
        thickest_m: Radius of the thickest stem that the cloud shows.

    Raises:
        FoliageError: It fails here and now, as on a full disk.
    """
    try:
        found = find_photographed_stems(call, thickest_m)
    except FoliageError as error:
        if fails_now(error):
            raise
        text = f"stems were not looked for in the photographs: {error.text}"
        failures.append(remark("stems-not-looked-for", text, remedy=error.remedy))
        return None
    if isinstance(found, NoStems):
        failures.append(describe_no_stems(found))
        return None
    return found


def find_photographed_stems(call: StageCall, thickest_m: float = 0.0) -> KnownStems | NoStems:
    """The stems that are lines in the photographs of the plant's capture, in the capture's axes with Y up.

    Where the photographs show none, or the plant has stems that are too thick for lines, as a tree has, the reason.

    Args:
        call: Of the task.
        thickest_m: Radius of the thickest stem that the cloud shows.

    Raises:
        FoliageError: The capture cannot be read.
    """
    folder = plant_capture(call)
    capture = read_capture(folder)
    upright = capture.asset_from_world
    cloud = read_cloud(folder / CLOUD_FILE, capture.settings.metres_per_unit)
    box_m = plant_box(cloud.points_m @ upright[:3, :3].T + upright[:3, 3], stand_height_m(call))
    settings = PhotographedStemSettings()
    if box_m is None:
        return NoStems.NOTHING_STANDS
    if thickest_m > _thickest_line_m(capture, upright, box_m, settings):
        return NoStems.TOO_THICK
    views = [
        replace(view, camera=turned_camera(view.camera, upright))
        for view in read_views(capture, progress_in_step("capture", call.progress)).views
    ]
    captured = read_captured_leaves(call.result_of(LEAVES)) if call.has(LEAVES) else None
    leaves = FoundLeafPlaces.none()
    if captured is not None:
        moved = capture.asset_from_capture @ np.linalg.inv(captured.own_from_capture)
        leaves = leaf_places(move_leaves(captured.fitted.leaves, moved), captured.certainty)
    joined = reconstruct_stems(views, box_m, leaves, settings, call.progress, threads=call.threads)
    if isinstance(joined, NoStems):
        return joined
    return KnownStems(
        skeleton=joined.skeleton,
        own_from_cloud=capture.asset_from_capture,
        leaves=len(leaves.bases_m),
        certainty=leaves.certainty,
        turned=np.flatnonzero(joined.turned).astype(np.int32),
        unjoined=np.flatnonzero(joined.leaf < 0).astype(np.int32),
        apart=joined.apart,
    )


def describe_no_stems(reason: NoStems) -> Remark:
    """That branches are those of the cloud, and why photographs show no stems."""
    none = "photographs show no stems, and branches are those of the cloud"
    if reason is NoStems.NOTHING_STANDS:
        return remark("stems-of-nothing", f"{none}: nothing of it is above what the plant stands on")
    if reason is NoStems.TOO_THICK:
        return remark("stems-too-thick-for-lines", f"{none}: the thickest stem is too thick to be a line in them")
    if reason is NoStems.FEW_PHOTOGRAPHS:
        return remark("stems-in-few-photographs", f"{none}: stems are lines that two photographs or more show")
    if reason is NoStems.NO_LINES:
        return remark("stems-without-lines", f"{none}: no thin line is seen in enough of them")
    return remark("stems-not-joined", f"{none}: what they show does not make a stem from the soil up")


def _thickest_line_m(
    capture: Capture, upright: NDArray[np.float64], box_m: NDArray[np.float64], settings: PhotographedStemSettings
) -> float:
    """Radius of what is as wide as a line may be, at the plant's distance from the median photograph."""
    cameras = [turned_camera(view.lens.pinhole(view.cam_from_world), upright) for view in capture.views]
    middle_m = box_m.mean(axis=0)
    footprints_m = [float(np.linalg.norm(camera.position_m - middle_m)) / camera.focal_px[0] for camera in cameras]
    return 0.5 * settings.lines.widest_px * float(np.median(footprints_m)) * _THICKER


def turned_camera(camera: Pinhole, upright_from_world: NDArray[np.float64]) -> Pinhole:
    """The camera in a world that is turned and moved (4, 4)."""
    own = np.vstack([camera.cam_from_world, [0, 0, 0, 1]]) @ np.linalg.inv(upright_from_world)
    return replace(camera, cam_from_world=own[:3])


def plant_box(points_m: NDArray[np.float64], stand_m: float | None) -> NDArray[np.float64] | None:
    """(2, 3) corners of where a plant of points (N, 3), Y up, is, from where it stands up; None where nothing is."""
    above_m = points_m if stand_m is None else points_m[points_m[:, 1] > stand_m]
    if not len(above_m):
        return None
    low_m, high_m = np.quantile(above_m, _WITHIN, axis=0)
    beside_m = _BESIDE * float((high_m - low_m).max())
    box_m = np.array([low_m - beside_m, high_m + beside_m])
    if stand_m is not None:
        box_m[0, 1] = stand_m
    return box_m if (box_m[1] > box_m[0]).all() else None


def leaf_places(leaves: Leaves, certainty: NDArray[np.float64] | None) -> FoundLeafPlaces:
    """Where leaves begin and end, and where their blades are; certainty (L,) that the base is the base, if known."""
    known = np.full(len(leaves), 0.5) if certainty is None else certainty
    blades_m = []
    for leaf_set, end in ((known >= _SURE, 1.0), (known < _SURE, 1 - _OF_BASE)):
        own = leaves.take(leaf_set)
        places = grid_places(np.linspace(-1, 1, _ACROSS), np.linspace(_OF_BASE, end, _ALONG))
        blades_m.append(evaluate_points(own.parameters, places, placements=own.asset_from_leaf()).reshape(-1, 3))
    return FoundLeafPlaces(
        bases_m=leaves.base_m,
        apices_m=leaves.asset_from_leaf()[:, :3] @ (0.0, 1.0, 0.0, 1.0),
        certainty=known,
        blades_m=np.concatenate(blades_m),
    )
