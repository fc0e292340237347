"""Exports in Storm, which knows nothing of us there, beside the asset."""

from pathlib import Path

import numpy as np
import pytest
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, draw_views

from tests.support.leaves.commands import run
from tests.support.plant_assets import write_whole_plant

pytestmark = pytest.mark.preview


def draw(file: Path) -> np.ndarray:
    window = (-5.5, 5.5, -5.5, 5.5)
    view = PreviewView(output=Path("unused.png"), direction="front", orthographic=True, window=window)
    (picture,) = draw_views(file, [view], PreviewSettings(width_px=480, height_px=480))
    return picture


def test_an_export_looks_like_its_asset(tmp_path):
    """An edited plant, whose leaves Storm bends by our shader in the asset, and finds bent in the export."""
    write_whole_plant(tmp_path / "oak", crown=False, count=60)
    look = tmp_path / "look.usda"
    assert run("edit", tmp_path / "oak", "--width", 3, "--curl", 0.1, 0.2, 0.3, "-o", look) == 0
    assert run("export", look, "--profile", "standalone", "-o", tmp_path / "new") == 0
    assert run("export", look, "--profile", "usdz", "-o", tmp_path / "new.usdz") == 0
    asset, plain, packed, unedited = (
        draw(file)[..., 3] > 0.5
        for file in (look, tmp_path / "new" / "new.usdc", tmp_path / "new.usdz", tmp_path / "oak" / "oak.usda")
    )
    assert asset.sum() > 2000

    def overlap(one, other):
        return (one & other).sum() / (one | other).sum()

    assert overlap(asset, plain) > 0.97
    assert overlap(asset, packed) > 0.97
    assert overlap(unedited, plain) < 0.9  # what it would be without the edits
