"""Poses of a run, and the remarks on them."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from usdfoliage.capture.folder.read import Capture
from usdfoliage.capture.folder.settings import CaptureSettings
from usdfoliage.cli.remarks import render_for
from usdfoliage.errors import CaptureError
from usdfoliage.jobs.capture import poses
from usdfoliage.jobs.capture.poses import estimate_poses
from usdfoliage.jobs.capture.settings import CaptureRunSettings
from usdfoliage.remarks import Remark, as_plan_setting, explain_error, remark, warnings_of

UP = remark("up-uncertain", "up is found by level and may be wrong by 6°")
SCALE = remark("scale-unknown", "the scale is unknown, and the median distance is taken for 1 m")


def test_an_unknown_scale_and_an_uncertain_up_are_warnings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in(monkeypatch)
    (tmp_path / "images").mkdir()
    posed = estimate_poses(tmp_path, None, CaptureRunSettings())
    assert set(warnings_of(posed.remarks)) == {UP, SCALE}


def test_cameras_that_are_probably_wrong_end_the_run_unless_they_are_wanted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    horizon = remark("points-in-a-band", "the points lie in a band, as of a horizon")
    stand_in(monkeypatch, (horizon,))
    (tmp_path / "images").mkdir()
    with pytest.raises(CaptureError, match="images are probably wrong") as raised:
        estimate_poses(tmp_path, None, CaptureRunSettings())
    assert 'a horizon; capture.uncertain_poses = "use" goes on' in explain_error(raised.value, as_plan_setting)
    used_so = 'a horizon; uncertain_poses = "use" in the settings file goes on'
    assert used_so in explain_error(raised.value, render_for("capture"))
    used = estimate_poses(tmp_path, None, CaptureRunSettings(uncertain_poses="use"))
    assert [each.code for each in warnings_of(used.remarks)][:2] == ["poses-improbable", "points-in-a-band"]


def stand_in(monkeypatch: pytest.MonkeyPatch, checks: tuple[Remark, ...] = ()) -> None:
    """Let everything but the decision be made by stand-ins."""
    registered = SimpleNamespace(remarks=checks)
    frame = SimpleNamespace(
        world_from_registered=np.eye(4),
        up_from="level",
        up_error_rad=0.1,
        scale_from="",
        scale_known=False,
        remarks=(UP, SCALE),
    )
    nothing = Capture(
        folder=Path("capture"), name="", settings=CaptureSettings(), views=(), points_m=np.zeros((0, 3)), remarks=()
    )
    photographs = SimpleNamespace(photos=(), dropped=(), remarks=())
    for name, made in (
        ("read_photo_set", photographs),
        ("register_photos", registered),
        ("level_and_scale", frame),
        ("move_registered", registered),
        ("write_colmap_model", None),
        ("read_capture", nothing),
        ("without_depth", nothing),
    ):
        monkeypatch.setattr(poses, name, lambda *_, made=made, **__: made)
