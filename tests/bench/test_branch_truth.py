"""The measure of an asset's branches against a true skeleton, as a command."""

import json

import numpy as np
import pytest
from pxr import Usd
from usdfoliage.asset.parts.branches import read_skeleton

from tests.support.plant_stages import write_asset
from tools.bench import branch_truth


@pytest.fixture
def asset(tmp_path):
    """An asset of which a metre is 100 units of its capture."""
    return write_asset(tmp_path / "oak")


def write_truth(folder, asset, shift):
    """The asset's own skeleton as the true one, in the frame of the capture, Z up."""
    stage = Usd.Stage.Open(str(asset))
    skeleton = read_skeleton(stage.GetPrimAtPath("/oak/geo/guide/Skeleton"))
    nodes, parent, order = [], [], []
    before = branch_truth.vertex_parents(skeleton)
    for curve in range(len(skeleton)):
        for vertex in range(skeleton.first[curve], skeleton.first[curve] + skeleton.counts[curve]):
            nodes.append((100 * skeleton.points_m[vertex] + shift).tolist())
            parent.append(int(before[vertex]))
            order.append(int(skeleton.order[curve]))
    radius = (100 * skeleton.radius_m).tolist()
    (folder / "truth").mkdir(parents=True)
    truth = {"nodes": nodes, "parent": parent, "order": order, "radius": radius}
    (folder / "truth" / "skeleton.json").write_text(json.dumps(truth))


def measure(capsys, monkeypatch, asset, capture):
    monkeypatch.setattr("sys.argv", ["branch_truth.py", str(asset.parent), str(capture)])
    assert branch_truth.main() == 0
    return {line.split()[0]: line.split()[1:] for line in capsys.readouterr().out.splitlines()}


def test_an_asset_is_like_its_own_skeleton(tmp_path, asset, capsys, monkeypatch):
    write_truth(tmp_path / "capture", asset, np.zeros(3))
    measures = measure(capsys, monkeypatch, asset, tmp_path / "capture")
    assert measures["recall"] == measures["precision"] == ["1"]
    assert float(measures["length_ratio"][0]) == pytest.approx(1, abs=1e-5)


def test_an_asset_beside_the_true_skeleton_is_not_found(tmp_path, asset, capsys, monkeypatch):
    write_truth(tmp_path / "capture", asset, np.array([1e4, 0, 0]))
    measures = measure(capsys, monkeypatch, asset, tmp_path / "capture")
    assert measures["recall"] == measures["precision"] == measures["ancestry"] == ["0"]
