"""Poses of a run, and what is doubtful of them."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from usdfoliage.errors import CaptureError
from usdfoliage.jobs.capture import poses
from usdfoliage.jobs.capture.poses import estimate_poses
from usdfoliage.jobs.capture.settings import CaptureRunSettings

UP, SCALE = "up is found by level and may be wrong by 5°", "the scale is unknown: the median distance is taken for 1 m"


@pytest.mark.parametrize(("scale_known", "doubts"), [(True, ()), (False, (SCALE,))])
def test_an_unknown_scale_is_a_doubt_and_not_only_a_note(
    scale_known: bool, doubts: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stand_in(monkeypatch, scale_known=scale_known)
    (tmp_path / "images").mkdir()
    posed = estimate_poses(tmp_path, None, CaptureRunSettings())
    assert posed.doubts == doubts
    assert {UP, SCALE} <= set(posed.notes)


def test_cameras_that_are_probably_wrong_end_the_run_unless_they_are_wanted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    horizon = "the points lie in a band, as of a horizon"
    stand_in(monkeypatch, doubts=(horizon,))
    (tmp_path / "images").mkdir()
    with pytest.raises(CaptureError, match=r'images are probably wrong.*a horizon \(doubtful_poses = "use"'):
        estimate_poses(tmp_path, None, CaptureRunSettings())
    used = estimate_poses(tmp_path, None, CaptureRunSettings(doubtful_poses="use"))
    assert used.registered is not None
    assert used.registered.doubts == (horizon,)


def stand_in(monkeypatch: pytest.MonkeyPatch, *, scale_known: bool = True, doubts: tuple[str, ...] = ()) -> None:
    """Let everything but the decision be made by stand-ins."""
    registered = SimpleNamespace(doubts=doubts, notes=doubts)
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
        monkeypatch.setattr(poses, name, lambda *_, made=made, **__: made)
