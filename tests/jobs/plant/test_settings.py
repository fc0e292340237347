"""The values a plan may have: an impossible value is refused when the plan is read, not hours later."""

from pathlib import Path

import pytest
from usdfoliage.errors import FoliageError
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.work.settings_file import read_settings_file

ROUND = "[capture.depth]\nrounds = [{{ level = {}, iterations = {}, coherent = false, segments = false }}]"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[plant]\nrepresentations = ["x"]', "representations must be one or more of bezier, nurbs, subdiv, mesh"),
        ("[plant]\nrepresentations = []", "not none"),
        ('[plant]\nrepresentations = ["mesh", "mesh"]', "each once"),
        (ROUND.format(-1, 1), "level must be 0 to 16, not -1"),
        (ROUND.format(40, 1), "level must be 0 to 16, not 40"),
        (ROUND.format(1, 0), "iterations must be 1 to 1000, not 0"),
        (ROUND.format(1, 100_000_000), "iterations must be 1 to 1000, not 100000000"),
        ("[pictures]\nturntable_frames = 100_000_000", "turntable_frames must be 2 to 3600, not 100000000"),
        ("[plant]\ngrowth_frames = 1", "growth_frames must be 0, or 2 to 10000, not 1"),
        ("[branches]\nvariations = 100", "variations must be 0 to 99, not 100"),
        ('[branches]\nmake = "off"\nvariations = 1', "variations need branches"),
        ('[branches]\nmake = "off"\n[plant]\ngrowth_frames = 9', "growth_frames asks for branches"),
        ("[pictures]\nturntable_frames = 1", "turntable_frames must be 2 to 3600, not 1"),
    ],
)
def test_an_impossible_value_is_refused_when_the_plan_is_read(tmp_path: Path, text: str, message: str) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text(text)
    with pytest.raises(FoliageError, match=r"plan\.toml") as refused:
        read_settings_file(plan, BuildSettings())
    assert message in str(refused.value)


def test_any_of_the_representations_will_do(tmp_path: Path) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text('[plant]\nrepresentations = ["mesh", "bezier"]')
    assert read_settings_file(plan, BuildSettings()).plant.representations == ("mesh", "bezier")
