"""The cameras of a COLMAP model without those of some photographs."""

from collections.abc import Container
from pathlib import Path

import numpy as np

from usdfoliage.capture.colmap.model import find_camera_model, read_camera_model, read_model_points
from usdfoliage.capture.poses.colmap_writer import write_colmap_model
from usdfoliage.capture.poses.result import Registered, RegisteredPhoto


def write_model_without(cameras: Path, target: Path, left_out: Container[str]) -> None:
    """Write the model below a folder once more, as text, without some photographs; its points stay, without tracks.

    Args:
        cameras: The folder that holds the model, or one above it.
        target: The folder of the new model.
        left_out: Names of photographs.

    Raises:
        CaptureError: There is no model, or it is damaged; a file cannot be written.
    """
    model = read_camera_model(find_camera_model(cameras))
    points = read_model_points(model.folder)
    photos = tuple(
        RegisteredPhoto(
            name=image.name,
            lens=model.lenses[image.camera_id],
            cam_from_world=image.cam_from_world,
            error_px=0.0,
            points=0,
        )
        for image in model.images
        if image.name not in left_out
    )
    registered = Registered(
        photos=photos,
        points=points,
        srgb=np.zeros((len(points), 3), np.uint8),
        error_px=np.zeros(len(points)),
        track_starts=np.zeros(len(points) + 1, np.int64),
        track_photos=np.zeros(0, np.int64),
        track_places_px=np.zeros((0, 2)),
        names=tuple(photo.name for photo in photos),
        matches=np.zeros((len(photos), len(photos)), np.int64),
        failures=(),
        remarks=(),
    )
    write_colmap_model(target, registered)
