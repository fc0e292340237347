"""Poses of a run, and what is doubtful of them."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from usdfoliage.jobs import capture_poses
from usdfoliage.jobs.capture_poses import estimate_poses
from usdfoliage.jobs.capture_settings import CaptureRunSettings

UP, SCALE = "up is found by level and may be wrong by 5°", "the scale is unknown: the median distance is taken for 1 m"


@pytest.mark.parametrize(("scale_known", "doubts"), [(True, ()), (False, (SCALE,))])
def test_an_unknown_scale_is_a_doubt_and_not_only_a_note(
    scale_known: bool, doubts: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    registered = SimpleNamespace(doubtful=False, notes=())
    frame = SimpleNamespace(
        world_from_registered=np.eye(4), up_from="level", scale_from="", scale_known=scale_known, notes=(UP, SCALE)
    )
    photographs = SimpleNamespace(photos=(), dropped=(), notes=())
    for name, made in (
        ("read_photo_set", photographs),
        ("register_photos", registered),
        ("level_and_scale", frame),
        ("move_registered", registered),
        ("write_colmap_model", None),
        ("read_capture", None),
        ("_without_depth", None),
    ):
        monkeypatch.setattr(capture_poses, name, lambda *_, made=made, **__: made)
    (tmp_path / "images").mkdir()
    posed = estimate_poses(tmp_path, None, CaptureRunSettings())
    assert posed.doubts == doubts
    assert {UP, SCALE} <= set(posed.notes)
