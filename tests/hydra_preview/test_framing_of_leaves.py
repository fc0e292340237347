"""An instancer is framed by what it draws, not by its box turned before the camera."""

from pathlib import Path

import numpy as np
import pytest
from usdfoliage.errors import PreviewError
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, draw_views
from usdfoliage.jobs.preview.recorder import find_interpreter
from usdfoliage.leaf.model import Leaves

from tests.support.leaves.assets import random_leaves, write_spray

pytestmark = pytest.mark.preview


@pytest.mark.parametrize("count", [30, 21000])
def test_leaves_on_a_ring_fill_the_picture(tmp_path, count):
    try:
        find_interpreter()
    except PreviewError as error:
        pytest.skip(f"the preview interpreter is absent: {error}")
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    leaves = Leaves(
        parameters=random_leaves(1).parameters.repeat(count, axis=0),
        base_m=np.column_stack([np.cos(turn), np.sin(turn), np.zeros(count)]),
        orientation=np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)),
        length_m=np.full(count, 0.02),
        phase=np.zeros(count),
    )
    asset = write_spray(tmp_path, leaves, representations=("bezier",))  # the one that is drawn
    # A ring whose box, seen at an angle, is far wider than itself.
    view = PreviewView(output=Path("unused.png"), direction="three-quarter")
    (picture,) = draw_views(asset, [view], PreviewSettings(width_px=200, height_px=200))
    rows, columns = np.nonzero(picture[..., 3] > 0)
    assert max(np.ptp(rows), np.ptp(columns)) > 160
    assert min(rows.min(), columns.min()) > 2
    assert max(rows.max(), columns.max()) < 197
