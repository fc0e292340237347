"""The benchmark of leaves measures what a run writes, and reports missed targets."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from usdfoliage.asset.packages.leaf_package import write_leaf_asset
from usdfoliage.asset.parts.leaf_part import LeafAssetSettings
from usdfoliage.asset.provenance import Provenance

from tests.support.leaves.captures import exact_leaves, known_foliage
from tools.bench import leaves as bench
from tools.bench.leaf_truth import move_leaves, read_exact_depth, read_true_leaves, score_leaves, visible_shares
from tools.synthetic.scaled import scale_capture
from tools.synthetic_foliage import write_capture

ASSET_FROM_CAPTURE = np.array([[1.0, 0, 0, 0.5], [0, 0, 1, 0.25], [0, -1, 0, 2], [0, 0, 0, 1]])  # the capture is Z up


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    folder = tmp_path_factory.mktemp("captures") / "bed"
    write_capture(folder, known_foliage(up_axis="Z").capture)
    return folder


def write_truth_as_asset(case, output, progress):
    """What a perfect run would write, of all leaves but the first."""
    with np.load(case.capture / "truth" / "leaves.npz") as arrays:
        leaves = exact_leaves(arrays)
    leaves = move_leaves(leaves.take(np.arange(1, len(leaves))), ASSET_FROM_CAPTURE)
    progress("segmentation", 0.0)
    progress("fit", 0.0)
    output.mkdir()
    write_leaf_asset(
        output,
        "leaves",
        leaves,
        Provenance(capture="", generator="", seed=0, input_sha256=""),
        LeafAssetSettings(representations=("bezier",)),
        asset_from_capture=ASSET_FROM_CAPTURE,
    )


def test_an_asset_is_measured_in_the_frame_of_its_capture(capture):
    case = bench.Case(capture=capture)
    result = bench.run_case(case, write_truth_as_asset)
    assert (result.scores.found, result.scores.matched, result.scores.precision) == (39, 39, 1)
    assert result.scores.recall > 0.95
    assert result.scores.distance_percent < 1.2
    assert result.scores.base_right == 1
    assert list(result.seconds) == ["start", "segmentation", "fit"]
    assert result.wall_s == pytest.approx(sum(result.seconds.values()))
    assert result.peak_gib > 0.05
    assert (result.views, result.pixels) == (4, 4 * 480 * 360)
    assert bench.check_result("bed", case, result) == []


def test_missed_targets_are_named(capture):
    case = bench.Case(capture=capture)
    result = bench.run_case(case, write_truth_as_asset)
    poor = replace(result.scores, recall=0.5, axis_error_deg=float("nan"), half_hidden=1, half_hidden_length_error=0.3)
    slow = replace(result, scores=poor, seconds={"fit": 61.0}, peak_gib=3.5)
    missed = " ".join(bench.check_result("bed", case, slow))
    for words in ("recall 0.5 below 0.92", "axis_error_deg nan", "half_hidden_length_error 0.3", "61.0 s", "3.50 GiB"):
        assert words in missed
    noisy = bench.check_result("bed", replace(case, depth="depth_noisy"), replace(result, scores=poor))
    assert any("below 0.8" in miss for miss in noisy)


def test_results_print_as_a_table(capture, capsys):
    result = bench.run_case(bench.Case(capture=capture), write_truth_as_asset)
    bench.print_result("bed depth dense", bench.print_head(["bed depth dense"]), result)
    bench.print_stages([("bed depth dense", result)])
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[:4] == ["true", "found", "recall", "precision"]
    assert lines[1].startswith("bed depth dense")
    assert len(lines[0]) == len(lines[1])
    assert lines[3].split() == ["cpu", "s", "(s)", "start", "segmentation", "fit"]
    assert [line.split()[0] for line in lines[4:]] == ["bed", "ms"]


@pytest.mark.parametrize("factor", [0.1, 10.0])
def test_a_scaled_capture_has_the_same_leaves(capture, tmp_path, factor):
    scale_capture(capture, tmp_path / "scaled", factor)
    truth, scaled = read_true_leaves(capture), read_true_leaves(tmp_path / "scaled")
    np.testing.assert_allclose(scaled.length_m, factor * truth.length_m, rtol=1e-6)
    views, scaled_views = read_exact_depth(capture), read_exact_depth(tmp_path / "scaled")
    for (camera, depth_m), (scaled_camera, scaled_depth_m) in zip(views, scaled_views, strict=True):
        np.testing.assert_allclose(scaled_camera.position_m, factor * camera.position_m, rtol=1e-9)
        np.testing.assert_allclose(scaled_depth_m, factor * depth_m, rtol=1e-6)
    assert (tmp_path / "scaled" / "images" / "000.jpg").is_file()
    with np.load(tmp_path / "scaled" / "truth" / "leaves.npz") as arrays:
        leaves = exact_leaves(arrays)
    within = bench.TruthSettings(visible_within_m=0.004 * factor)
    seen = visible_shares(scaled, scaled_views, within).max(axis=1)
    np.testing.assert_allclose(seen, visible_shares(truth, views).max(axis=1), atol=0.02)
    assert score_leaves(scaled, seen, leaves, within).recall == 1


def test_exact_depth_of_a_capture_of_photographs_alone_is_beside_the_true_leaves(capture, tmp_path):
    alone = tmp_path / "alone"
    shutil.copytree(capture, alone)
    (alone / "depth").rename(alone / "truth" / "depth")
    views, expected = read_exact_depth(alone), read_exact_depth(capture)
    assert len(views) == len(expected) > 0
    for (_, depth_m), (_, expected_m) in zip(views, expected, strict=True):
        np.testing.assert_array_equal(depth_m, expected_m)
    shutil.rmtree(alone / "truth" / "depth")
    with pytest.raises(ValueError, match="neither truth/depth nor depth"):
        read_exact_depth(alone)


def test_a_capture_cannot_be_scaled_to_nothing(capture, tmp_path):
    with pytest.raises(ValueError, match="factor"):
        scale_capture(capture, tmp_path / "none", 0.0)
