"""Small captures of a whole plant, made once a session."""

from functools import cache
from pathlib import Path

from tools.synthetic.plant import PlantSettings
from tools.synthetic_plant import PlantCapture, PlantCaptureSettings, make_plant_capture, write_plant_capture


@cache
def known_plant(
    views: int = 8,
    size: tuple[int, int] = (180, 240),
    leaves: int = 120,
    seed: int = 0,
    up_axis: str = "Z",
    masks: bool = False,
) -> PlantCapture:
    """A young tree 1.4 m high, with exact depth, seen from all around; some seconds the first time."""
    plant = PlantSettings(views=views, width_px=size[0], height_px=size[1], leaves=leaves, seed=seed)
    return make_plant_capture(PlantCaptureSettings(plant=plant, up_axis=up_axis, masks=masks))


def write_known_plant(folder: Path, *, masks: bool = False) -> PlantCapture:
    """The capture folder of 8 small photographs with their cameras, for builds; the same bytes every time."""
    capture = known_plant(masks=masks)
    write_plant_capture(folder, capture)
    return capture
