"""The part of pose estimation that calls COLMAP, in a process of its own: where COLMAP crashes, only that one ends.

usage: python -m usdfoliage.capture.poses.worker JOB.json

Files in, files out, each of which appears whole or not at all. For each item N of the job there is a line on the
standard output: "done N", "failed N reason", or "full-disk N reason" where there was no room for it.
"""

import json
import sys
import tempfile
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
from numpy.typing import NDArray

from usdfoliage.capture.folder.photo_set import read_gray
from usdfoliage.capture.poses.adjustment import adjust_cameras, known_camera, match_with_cameras
from usdfoliage.capture.poses.child_process import JOB
from usdfoliage.capture.poses.pairs import MatchSettings, match_descriptors
from usdfoliage.errors import CaptureError
from usdfoliage.files.free_space import is_full_disk, require_space
from usdfoliage.files.npz import read_arrays, write_arrays

Arrays = Mapping[str, NDArray[Any]]

_DESCRIPTOR = 128  # numbers
_PLACES = 0.1  # share of a file of features, beside their descriptors
_MAX_TRIALS = 2000  # finds what 44 % of the matches agree on; photographs that overlap agree on more
_TURN_ERROR_PX = 3.0
_TURN_TRIALS = (100, 1000)  # at least and at most
_MIN_SIMILAR = 20  # descriptors, below which a motion explains what it explains by chance


def main(arguments: Sequence[str]) -> int:
    """Do the job in a file; 0, or 2 where the job is none."""
    if len(arguments) != 1:
        print(__doc__, file=sys.stderr)
        return 2
    pycolmap.logging.minloglevel = pycolmap.logging.Level.ERROR.value
    job = json.loads(Path(arguments[0]).read_text(encoding="utf-8"))
    tasks = {
        "features": _find_features,
        "compare": _compare,
        "match": _match_photos,
        "turns": _find_turns,
        "map": _map_photos,
        "match-again": match_with_cameras,
        "adjust": _adjust,
    }
    task = tasks[job["task"]]
    for number, item in job["items"]:
        try:
            write_arrays(Path(item["out"]), task(item, job))
        except (CaptureError, OSError) as error:
            kind = "full-disk" if is_full_disk(error) else "failed"
            if kind == "failed" and not isinstance(error, CaptureError):
                raise
            print(kind, number, str(error).replace("\n", " "), flush=True)
        else:
            print("done", number, flush=True)
    return 0


def _find_features(item: Mapping[str, Any], job: Mapping[str, Any]) -> Arrays:
    """SIFT features of one photograph, the coarsest first."""
    gray = read_gray(Path(item["photo"]), job["max_side_px"])
    keypoints, descriptors = _sift(gray, first_octave=0, job=job)
    if len(keypoints) < job["min_features"]:  # four times the time, and what is found is less exactly placed
        keypoints, descriptors = _sift(gray, first_octave=-1, job=job)
    order = np.argsort(-keypoints[:, 2], kind="stable")[: job["features"]]
    return {
        "keypoints": keypoints[order],
        "descriptors": descriptors[order],
        "size": np.array([gray.shape[1], gray.shape[0]]),
    }


def _sift(gray: NDArray[np.uint8], first_octave: int, job: Mapping[str, Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    options = pycolmap.FeatureExtractionOptions()
    options.use_gpu = False
    options.num_threads = 1
    options.sift.first_octave = first_octave
    options.sift.peak_threshold = job["peak_threshold"]
    options.sift.max_num_features = job["features"]
    extractor = pycolmap.FeatureExtractor.create(options, pycolmap.Device.cpu)
    keypoints, descriptors = extractor.extract_from_uint8_array(np.ascontiguousarray(gray))
    places = np.asarray(pycolmap.keypoints_to_matrix(keypoints), np.float32).reshape(-1, 4)
    return places, np.asarray(descriptors.data, np.uint8).reshape(len(places), _DESCRIPTOR)


def _compare(item: Mapping[str, Any], job: Mapping[str, Any]) -> Arrays:
    """How many of the coarsest features of one photograph match in others: cheap, and enough to find its neighbours."""
    few, settings = job["coarse_features"], MatchSettings(max_ratio=job["max_ratio"])
    first = _coarsest(job["features"][item["first"]], few)
    matched = [
        len(match_descriptors(first, _coarsest(job["features"][second], few), settings)) for second in item["seconds"]
    ]
    return {
        "first": np.array(item["first"], np.int64),
        "seconds": np.array(item["seconds"], np.int64),
        "similar": np.array(matched, np.int64),
    }


@lru_cache(maxsize=2000)
def _coarsest(feature_file: str, count: int) -> NDArray[np.uint8]:
    return read_arrays(Path(feature_file))["descriptors"][:count].copy()


def _match_photos(item: Mapping[str, Any], job: Mapping[str, Any]) -> Arrays:
    """Matches of one photograph with others, those that one motion of a camera explains."""
    first = read_arrays(Path(job["features"][item["first"]]))
    camera = known_camera(1, job["cameras"][item["first"]])
    settings = MatchSettings(max_ratio=job["max_ratio"])
    counts, configs, angles, geometry, matches = [], [], [], [], [np.zeros((0, 2), np.uint32)]
    tried = []
    for second_index in item["seconds"]:
        second = read_arrays(Path(job["features"][second_index]))
        matched = match_descriptors(first["descriptors"], second["descriptors"], settings)
        found = _verify(first, second, camera, known_camera(2, job["cameras"][second_index]), matched, job["seed"])
        inliers = np.asarray(found.inlier_matches, np.uint32).reshape(-1, 2)
        tried.append(len(matched))
        counts.append(len(inliers))
        configs.append(int(found.config))
        angles.append(float(found.tri_angle))
        geometry.append(_geometry(found))
        matches.append(inliers)
    return {
        "first": np.array(item["first"], np.int64),
        "seconds": np.array(item["seconds"], np.int64),
        "similar": np.array(tried, np.int64),
        "counts": np.array(counts, np.int64),
        "configs": np.array(configs, np.int64),
        "angles": np.array(angles, np.float64),
        "geometry": np.array(geometry, np.float64).reshape(-1, 4, 3, 4),
        "matches": np.concatenate(matches),
    }


def _verify(
    first: Arrays, second: Arrays, camera: Any, other: Any, matched: NDArray[np.uint32], seed: int
) -> "pycolmap.TwoViewGeometry":
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.random_seed = seed
    options.ransac.max_num_trials = _MAX_TRIALS
    options.ransac.num_threads = 1
    options.compute_relative_pose = True
    options.detect_watermark = False
    pycolmap.set_random_seed(seed)
    if len(matched) < _MIN_SIMILAR:
        return pycolmap.TwoViewGeometry()
    return pycolmap.estimate_two_view_geometry(
        camera, first["keypoints"][:, :2].astype(np.float64),
        other, second["keypoints"][:, :2].astype(np.float64), matched, options,
    )  # fmt: skip


def _find_turns(item: Mapping[str, Any], job: Mapping[str, Any]) -> Arrays:
    """How the camera turned between the photographs of a file of matches, with lenses that are known by now."""
    found = read_arrays(Path(item["matches"]))
    number = int(found["first"])
    first, ends = read_arrays(Path(job["features"][number])), np.cumsum(found["counts"])
    options = pycolmap.RANSACOptions()
    options.max_error, options.random_seed = _TURN_ERROR_PX, job["seed"]
    options.min_num_trials, options.max_num_trials = _TURN_TRIALS
    seconds, turns, counts = [], [], []
    for place, second_number in enumerate(found["seconds"].tolist()):
        count = int(found["counts"][place])
        if count < job["min_matches"]:
            continue
        matches = found["matches"][ends[place] - count : ends[place]]
        second = read_arrays(Path(job["features"][second_number]))
        pycolmap.set_random_seed(job["seed"])
        motion = pycolmap.estimate_essential_matrix(
            first["keypoints"][matches[:, 0], :2].astype(np.float64),
            second["keypoints"][matches[:, 1], :2].astype(np.float64),
            known_camera(1, job["cameras"][number]),
            known_camera(2, job["cameras"][second_number]),
            options,
        )
        if motion is None:
            continue
        seconds.append(second_number)
        turns.append(motion["cam2_from_cam1"].matrix()[:, :3])
        counts.append(float(motion["num_inliers"]))
    return {
        "pairs": np.array([(number, second) for second in seconds], np.int64).reshape(-1, 2),
        "turn": np.array(turns, np.float64).reshape(-1, 3, 3),
        "matches": np.array(counts, np.float64),
    }


def _geometry(found: "pycolmap.TwoViewGeometry") -> NDArray[np.float64]:
    """(4, 3, 4): E, F, H and the second camera from the first; 0 for none."""
    packed = np.zeros((4, 3, 4))
    for place, matrix in enumerate((found.E, found.F, found.H)):
        if matrix is not None:
            packed[place, :, :3] = matrix
    if found.cam2_from_cam1 is not None:
        packed[3] = found.cam2_from_cam1.matrix()
    return packed


def _map_photos(item: Mapping[str, Any], job: Mapping[str, Any]) -> Arrays:
    """Cameras and points of the largest group of photographs that hang together."""
    with tempfile.TemporaryDirectory(prefix=JOB, dir=Path(item["out"]).parent) as folder:
        database = Path(folder) / "database.db"
        require_space(Path(folder), _min_database_bytes(job))  # COLMAP aborts where its database does not fit
        _write_database(database, job)
        pycolmap.set_random_seed(job["seed"])
        (Path(folder) / "models").mkdir()
        models = _map_globally(database, job) if job["mapper"] == "global" else _map_incrementally(database, job)
    models = sorted(models, key=lambda model: (-model.num_reg_images(), -model.num_points3D()))
    return _pack(models, job)


def _adjust(item: Mapping[str, Any], job: Mapping[str, Any]) -> Arrays:
    """Cameras and points of a model whose photographs were matched again."""
    return _pack([adjust_cameras(item, job, _write_database)], job)


def _min_database_bytes(job: Mapping[str, Any]) -> int:
    """What the database takes at least: all matches, and of the features their places alone."""
    features, matches = (sum(Path(name).stat().st_size for name in job[kind]) for kind in ("features", "matches"))
    return int(_PLACES * features) + matches


def _write_database(path: Path, job: Mapping[str, Any]) -> None:
    database = pycolmap.Database.open(str(path))
    with pycolmap.DatabaseTransaction(database):
        cameras: dict[int, int] = {}
        for index, (feature_file, values) in enumerate(zip(job["features"], job["cameras"], strict=True)):
            group = values["group"]
            if group not in cameras:
                cameras[group] = group + 1
                database.write_camera(known_camera(group + 1, values), use_camera_id=True)
                rig = pycolmap.Rig()
                rig.rig_id = group + 1
                rig.add_ref_sensor(pycolmap.sensor_t(type=pycolmap.SensorType.CAMERA, id=group + 1))
                database.write_rig(rig, use_rig_id=True)
            image = pycolmap.Image()
            image.name, image.camera_id, image.image_id = f"{index:06d}", group + 1, index + 1
            database.write_image(image, use_image_id=True)
            frame = pycolmap.Frame()
            frame.frame_id, frame.rig_id = index + 1, group + 1
            frame.add_data_id(
                pycolmap.data_t(
                    sensor_id=pycolmap.sensor_t(type=pycolmap.SensorType.CAMERA, id=group + 1), id=index + 1
                )
            )
            database.write_frame(frame, use_frame_id=True)
            database.write_keypoints(index + 1, read_arrays(Path(feature_file))["keypoints"])
        place = {number: index for index, number in enumerate(job["numbers"])}
        for match_file in job["matches"]:
            _write_matches(database, read_arrays(Path(match_file)), place, job)
    database.close()


def _write_matches(database: Any, found: Arrays, place_of: Mapping[int, int], job: Mapping[str, Any]) -> None:
    wanted = None if job.get("pairs") is None else {tuple(pair) for pair in job["pairs"]}
    ends = np.cumsum(found["counts"])
    for place, second in enumerate(found["seconds"]):
        count = int(found["counts"][place])
        if count < job["min_matches"] or (wanted is not None and (int(found["first"]), int(second)) not in wanted):
            continue
        geometry = pycolmap.TwoViewGeometry()
        geometry.config = int(found["configs"][place])
        packed = found["geometry"][place]
        if packed[0].any():
            geometry.E = packed[0, :, :3]
        if packed[1].any():
            geometry.F = packed[1, :, :3]
        if packed[2].any():
            geometry.H = packed[2, :, :3]
        if packed[3].any():
            geometry.cam2_from_cam1 = pycolmap.Rigid3d(packed[3])
        geometry.tri_angle = float(found["angles"][place])
        geometry.inlier_matches = found["matches"][ends[place] - count : ends[place]]
        first_id, second_id = place_of[int(found["first"])] + 1, place_of[int(second)] + 1
        database.write_matches(first_id, second_id, geometry.inlier_matches)
        database.write_two_view_geometry(first_id, second_id, geometry)


def _map_incrementally(database: Path, job: Mapping[str, Any]) -> list[Any]:
    options = pycolmap.IncrementalPipelineOptions()
    options.random_seed = options.mapper.random_seed = options.triangulation.random_seed = job["seed"]
    options.num_threads = options.mapper.num_threads = job["mapper_threads"]
    options.extract_colors = False
    options.min_model_size = min(3, len(job["cameras"]))
    options.max_num_models = 10
    options.min_num_matches = job["min_matches"]
    options.ba_global_frames_ratio = options.ba_global_points_ratio = job["global_ratio"]
    registered = 2

    def report() -> None:
        nonlocal registered
        registered += 1
        print("step", min(registered, len(job["cameras"])), len(job["cameras"]), flush=True)

    models = pycolmap.incremental_mapping(
        database, database.parent, database.parent / "models", options, next_image_callback=report
    )
    return list(models.values())


def _map_globally(database: Path, job: Mapping[str, Any]) -> list[Any]:
    if not all(values["known"] for values in job["cameras"]):
        pycolmap.calibrate_view_graph(database)
    options = pycolmap.GlobalPipelineOptions()
    options.random_seed = job["seed"]
    options.num_threads = options.mapper.num_threads = job["mapper_threads"]
    options.min_num_matches = job["min_matches"]
    return list(pycolmap.global_mapping(database, database.parent, database.parent / "models", options).values())


def _pack(models: Sequence[Any], job: Mapping[str, Any]) -> Arrays:
    """The first model as arrays, and which model each photograph is in."""
    group = np.full(len(job["cameras"]), -1, np.int64)
    for number, model in reversed(list(enumerate(models))):
        group[[image_id - 1 for image_id in model.reg_image_ids()]] = number
    packed: dict[str, NDArray[Any]] = {"group": group}
    if not models:
        return packed
    model = models[0]
    model.update_point_3d_errors()
    images = sorted(model.reg_image_ids())
    packed["images"] = np.array([image_id - 1 for image_id in images], np.int64)
    packed["cam_from_world"] = np.array([model.image(image_id).cam_from_world().matrix() for image_id in images])
    packed["parameters"] = np.array([model.image(image_id).camera.params for image_id in images])
    points = sorted(model.points3D.items())
    packed["points"] = np.array([point.xyz for _, point in points], np.float64).reshape(-1, 3)
    packed["errors"] = np.array([point.error for _, point in points], np.float64)
    tracks = [sorted({(e.image_id - 1, e.point2D_idx) for e in point.track.elements}) for _, point in points]
    packed["track_starts"] = np.cumsum([0, *map(len, tracks)]).astype(np.int64)
    packed["track"] = np.array([place for track in tracks for place in track], np.int64).reshape(-1, 2)
    return packed


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
