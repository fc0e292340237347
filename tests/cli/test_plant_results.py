"""What a build and a batch print of a plant that they could not make."""

from pathlib import Path

import pytest
from usdfoliage.cli.plant_results import format_plant, list_plant, print_plant
from usdfoliage.cli.remarks import render_for
from usdfoliage.jobs.plant.call import BuildRequest
from usdfoliage.jobs.plant.finish import BuiltPlant
from usdfoliage.jobs.plant.library import describe_built
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.remarks import Argument

from tests.support.commands.json_output import read_output

REQUEST = BuildRequest(
    capture=Path("fern"), output=Path("assets/fern"), name="fern", settings=BuildSettings(), work=Path("work")
)
FAILED = BuiltPlant(request=REQUEST, error="the folder is not empty", remedy=("use ", Argument(name="force")))


def test_a_build_names_an_argument_as_its_option(capsys: pytest.CaptureFixture[str]) -> None:
    print_plant(FAILED, "build")
    assert capsys.readouterr().err == "error: the folder is not empty; use --force\n"
    assert list_plant(FAILED, "build")["error"] == "the folder is not empty; use --force"
    assert read_output("build", format_plant(FAILED, "build"))["verdict"] == "failed"


def test_a_batch_does_so_too() -> None:
    described = describe_built(FAILED, Path("assets"))
    assert described.sentence(render_for("batch")) == "the folder is not empty; use --force"
