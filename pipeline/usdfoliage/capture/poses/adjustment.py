"""The part of the worker that matches again with cameras that are known nearly, and adjusts them to these matches."""

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
from numpy.typing import NDArray

from usdfoliage.capture.poses.child_process import JOB
from usdfoliage.capture.poses.guided_matches import GuidedMatchSettings, SeenFeatures, match_near_lines
from usdfoliage.files.npz import read_arrays

Arrays = Mapping[str, NDArray[Any]]
WriteDatabase = Callable[[Path, Mapping[str, Any]], None]

_MIN_ANGLE_DEG = 1.5  # between the rays of a point, as COLMAP's mapper has it
_CALIBRATED = 2  # COLMAP's configuration of a pair whose lenses are known


def known_camera(camera_id: int, values: Mapping[str, Any]) -> "pycolmap.Camera":
    """A camera of COLMAP by its model, its size and all its parameters."""
    camera = pycolmap.Camera.create_from_model_name(
        camera_id, values["model"], values["focal_px"], values["width_px"], values["height_px"]
    )
    camera.has_prior_focal_length = values["known"]
    if "parameters" in values:
        camera.params = [float(value) for value in values["parameters"]]
    return camera


def match_with_cameras(item: Mapping[str, Any], job: Mapping[str, Any]) -> Arrays:
    """Matches of one photograph with others by known cameras, packed as those without."""
    first, seen = item["first"], _seen_features(item["first"], job)
    counts, geometry, matches = [], [], [np.zeros((0, 2), np.uint32)]
    for second in item["seconds"]:
        motion = _motion(job["cam_from_world"][first], job["cam_from_world"][second])
        focal_px = min(job["cameras"][number]["parameters"][0] for number in (first, second))
        settings = GuidedMatchSettings(max_line=job["max_line_px"] / focal_px)
        found = match_near_lines(seen, _seen_features(second, job), motion, settings)
        packed = np.zeros((4, 3, 4))
        packed[3] = motion
        counts.append(len(found))
        geometry.append(packed)
        matches.append(found)
    return {
        "first": np.array(first, np.int64),
        "seconds": np.array(item["seconds"], np.int64),
        "similar": np.array(counts, np.int64),
        "counts": np.array(counts, np.int64),
        "configs": np.full(len(counts), _CALIBRATED, np.int64),
        "angles": np.full(len(counts), np.radians(10 * _MIN_ANGLE_DEG)),  # enough for COLMAP to use the pair
        "geometry": np.array(geometry, np.float64).reshape(-1, 4, 3, 4),
        "matches": np.concatenate(matches),
    }


def adjust_cameras(item: Mapping[str, Any], job: Mapping[str, Any], write_database: WriteDatabase) -> Any:
    """COLMAP's reconstruction by known cameras and their matches: points, and then all together."""
    pycolmap.set_random_seed(job["seed"])
    with tempfile.TemporaryDirectory(prefix=JOB, dir=Path(item["out"]).parent) as folder:
        database = Path(folder) / "database.db"
        write_database(database, job)
        options = pycolmap.IncrementalPipelineOptions()
        options.random_seed = options.mapper.random_seed = options.triangulation.random_seed = job["seed"]
        options.num_threads = options.mapper.num_threads = job["mapper_threads"]
        options.extract_colors = False
        options.mapper.filter_max_reproj_error = job["max_error_px"]
        options.triangulation.merge_max_reproj_error = job["max_error_px"]
        options.triangulation.complete_max_reproj_error = job["max_error_px"]
        options.triangulation.ignore_two_view_tracks = False
        (Path(folder) / "model").mkdir()
        model = pycolmap.triangulate_points(
            _reconstruction(job), str(database), folder, str(Path(folder) / "model"), True, options, False
        )
    adjustment = pycolmap.BundleAdjustmentOptions()
    adjustment.print_summary = False
    adjustment.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    adjustment.ceres.solver_options.num_threads = job["mapper_threads"]
    pycolmap.bundle_adjustment(model, adjustment)
    pycolmap.ObservationManager(model).filter_all_points3D(job["max_error_px"], _MIN_ANGLE_DEG)
    return model


def _reconstruction(job: Mapping[str, Any]) -> "pycolmap.Reconstruction":
    """Cameras and photographs, without a point; numbered as in the database."""
    model = pycolmap.Reconstruction()
    groups: set[int] = set()
    for index, (feature_file, values) in enumerate(zip(job["features"], job["cameras"], strict=True)):
        if values["group"] not in groups:
            groups.add(values["group"])
            model.add_camera_with_trivial_rig(known_camera(values["group"] + 1, values))
        places = read_arrays(Path(feature_file))["keypoints"][:, :2].astype(np.float64)
        image = pycolmap.Image(f"{index:06d}", places, values["group"] + 1, index + 1)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(np.array(job["cam_from_world"][index])))
    return model


def _seen_features(number: int, job: Mapping[str, Any]) -> SeenFeatures:
    arrays = read_arrays(Path(job["features"][number]))
    camera = known_camera(1, job["cameras"][number])
    rays = np.asarray(camera.cam_from_img(arrays["keypoints"][:, :2].astype(np.float64)), np.float64).reshape(-1, 2)
    rays = np.where(np.isfinite(rays), rays, 1e9)  # outside of what the lens shows: far from any line
    return SeenFeatures(
        rays=rays, size_px=arrays["keypoints"][:, 2].astype(np.float64), descriptors=arrays["descriptors"]
    )


def _motion(first: Any, second: Any) -> NDArray[np.float64]:
    """(3, 4), the second camera's frame from the first one's."""
    first_m, second_m = np.asarray(first, np.float64), np.asarray(second, np.float64)
    turn = second_m[:, :3] @ first_m[:, :3].T
    return np.column_stack([turn, second_m[:, 3] - turn @ first_m[:, 3]])
