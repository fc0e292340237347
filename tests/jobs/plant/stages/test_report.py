"""The last stages of a plant: what its pictures are measured against."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from usdfoliage.asset.packages.asset_shape import AssetShape
from usdfoliage.capture.folder.read import Capture
from usdfoliage.jobs.plant.asset_facts import AssetFacts, read_asset_facts, write_asset_facts
from usdfoliage.jobs.plant.pages.pictures import DrawnComparisons
from usdfoliage.jobs.plant.pages.report import Comparison
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.plant.stages import report as report_stage
from usdfoliage.jobs.plant.summary import read_summary
from usdfoliage.remarks import remark

from tests.support.captures import write_capture

NOT_COMPARED = remark("photographs-not-compared", "2.png is not compared: it cannot be read", subject="2.png")


@pytest.mark.parametrize(("stage", "masks"), [("isolation", "drawn"), ("isolation", "given"), ("cloud", "given")])
def test_the_plant_is_compared_by_the_masks_that_it_is_made_by(
    stage: str, masks: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    results = {name: tmp_path / name for name in {"cloud", "asset", "comparisons", stage}}
    write_capture(results[stage] / "capture" / "fern")
    if masks == "drawn":
        (results[stage] / "drawn_masks.txt").write_text("so they are")
    shape = AssetShape(extent_m=None, asset_from_capture=np.eye(4), variants={}, selections={})
    results["asset"].mkdir()
    origins = {"found": 1, "completed": 0, "filled_in": 2, "of_species": 0}
    facts = AssetFacts(leaves=3, foliage="filled", branches=0, shape=shape, origins=origins)
    write_asset_facts(results["asset"], facts)
    rows = [(row.name, row.value) for row in read_asset_facts(results["asset"]).count_rows()]
    assert rows == [("leaves", "3"), ("leaves by origin", "1 found, 2 filled in"), ("branches", "0")]
    seen: list[Capture] = []

    def draw(asset: Path, shape: AssetShape, capture: Capture, folder: Path, *rest: Any) -> DrawnComparisons:
        seen.append(capture)
        photograph, drawing = folder / "photograph.jpg", folder / "plant.png"
        compared = (
            Comparison(name="0.png", photograph=photograph, drawing=drawing, iou=0.75),
            Comparison(name="1.png", photograph=photograph, drawing=drawing),
        )
        return DrawnComparisons(comparisons=compared, remarks=(NOT_COMPARED,))

    monkeypatch.setattr(report_stage, "draw_comparisons", draw)
    results["comparisons"].mkdir()
    call: Any = SimpleNamespace(
        out=results["comparisons"],
        inputs=SimpleNamespace(name="fern"),
        settings=BuildSettings(),
        progress=None,
        report_parts=None,
        store=SimpleNamespace(folder=tmp_path),
        has=lambda name: name in results,
        result_of=lambda name: results[name],
        asset_result=results["asset"],
    )
    assert report_stage.compare_plant(call) == ()
    assert [capture.folder for capture in seen] == [results[stage] / "capture" / "fern"]
    summary = read_summary(results["comparisons"])
    assert summary.remarks == (NOT_COMPARED,)
    assert not summary.poor
    assert [each["masks"] for each in json.loads((results["comparisons"] / "compared.json").read_text())] == [masks, ""]
    assert [(each.iou, each.masks) for each in report_stage._read_comparisons(call)] == [(0.75, masks), (None, "")]


def test_no_pictures_are_tried_of_an_asset_whose_first_took_too_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    results = {name: tmp_path / name for name in ("asset", "turntable")}
    for folder in results.values():
        folder.mkdir()
    shape = AssetShape(extent_m=None, asset_from_capture=np.eye(4), variants={}, selections={})
    write_asset_facts(
        results["asset"], AssetFacts(leaves=3, foliage="filled", branches=0, shape=shape, is_drawable=False)
    )
    monkeypatch.setattr(report_stage, "draw_turntable", lambda *_: pytest.fail("it was drawn"))
    call: Any = SimpleNamespace(
        out=results["turntable"],
        settings=BuildSettings(),
        report_parts=None,
        result_of=lambda name: results[name],
        asset_result=results["asset"],
    )
    assert report_stage.turn_plant(call) == ()
    summary = read_summary(results["turntable"])
    assert [each.code for each in summary.remarks] == ["pictures-missing"]
    assert summary.poor
