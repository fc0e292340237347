"""The file of leaves that stages hand on: as an asset of the same leaves keeps them."""

from dataclasses import replace

import numpy as np
import pytest
from pxr import Usd
from usdfoliage.asset.parts.leaves import read_leaves
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.model_file import LeavesModel, read_leaves_model, write_leaves_model

from tests.support.leaves.assets import random_leaves, write_spray
from tests.support.model_files import check_model_file

MATRIX = np.array([[1, 0, 0, 0.1], [0, 0, 1, 1 / 3], [0, -1, 0, np.pi], [0, 0, 0, 1]])


def some_leaves(facts: bool) -> Leaves:
    """With numbers that no float32 holds, and orientations that are not quite unit."""
    leaves = random_leaves(12, facts=facts)
    shaken = {name: getattr(leaves, name) + 1e-9 for name in ("parameters", "base_m", "length_m", "phase")}
    leaves = replace(leaves, **shaken, orientation=leaves.orientation * np.linspace(0.5, 2, 12)[:, None])
    return replace(leaves, color=np.linspace(0.1, 0.9, 36).reshape(12, 3)) if facts else leaves


def same(one, other):
    return (one is None) == (other is None) and (one is None or np.array_equal(one, other))


@pytest.mark.parametrize("facts", [False, True])
def test_leaves_come_back_as_from_an_asset(tmp_path, facts):
    leaves = some_leaves(facts)
    model = LeavesModel(leaves=leaves, asset_from_capture=MATRIX, plain_color=(0.1, 0.2, 0.3) if facts else None)
    found = check_model_file(tmp_path, model, write_leaves_model, read_leaves_model, "parameters")
    interface = write_spray(tmp_path / "spray", leaves, representations=("bezier",))
    stage = Usd.Stage.Open(str(interface))
    wanted = read_leaves(stage.GetPrimAtPath("/spray/geo/render/Leaves")).leaves
    for name in Leaves.__dataclass_fields__:
        assert same(getattr(found.leaves, name), getattr(wanted, name)), name
    assert found.leaves.parameters.dtype == np.float64
    assert np.array_equal(found.asset_from_capture, MATRIX)  # to the last bit
    assert found.texture_color is None
    assert found.plain_color == (tuple(map(float, np.float32([0.1, 0.2, 0.3]))) if facts else None)


def test_no_leaves_are_a_model_too(tmp_path):
    nothing = random_leaves(3, facts=True).take(np.zeros(0, np.int64))
    write_leaves_model(tmp_path / "none.npz", LeavesModel(leaves=nothing, asset_from_capture=np.eye(4)))
    assert len(read_leaves_model(tmp_path / "none.npz").leaves) == 0
