"""What the page of a library has of a plant that was built."""

from pathlib import Path

from usdfoliage.jobs.plant.call import BuildRequest
from usdfoliage.jobs.plant.finish import BuiltPlant
from usdfoliage.jobs.plant.library import describe_built
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.report.table import Row


def test_the_numbers_of_a_plant_are_not_read_from_the_texts_of_its_report(tmp_path: Path) -> None:
    request = BuildRequest(
        capture=tmp_path / "fern",
        output=tmp_path / "library" / "fern",
        name="fern",
        settings=BuildSettings(),
        work=tmp_path / "work",
    )
    made = BuiltPlant(
        request=request,
        asset=request.output / "fern.usda",
        facts=(Row(name="height", value="so high"), Row(name="leaves", value="many")),
        height_m=6.40812,
        leaves=12_345,
        branches=0,
    )
    described = describe_built(made, tmp_path / "library")
    assert (described.height_m, described.leaves, described.branches) == (6.41, 12_345, 0)
    described = describe_built(BuiltPlant(request=request), tmp_path / "library")
    assert (described.height_m, described.leaves, described.branches) == (None, None, None)
