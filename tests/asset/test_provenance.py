"""What an asset records of the runs that made it."""

import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest
from pxr import Sdf
from usdfoliage.asset.looks.look import open_asset
from usdfoliage.asset.packages.contents import read_plant_facts, require_plant
from usdfoliage.asset.packages.plant_package import write_plant_asset
from usdfoliage.asset.provenance import CUSTOM_DATA_KEY, Provenance, combined_sha256, package_versions

from tests.support.plant_assets import RUN, some_leaves

INPUTS = {f"images/{number:03}.jpg": hashlib.sha256(bytes([number])).hexdigest() for number in range(100)}
FULL = replace(
    RUN,
    input_sha256=combined_sha256(INPUTS),
    inputs=INPUTS,
    stages={"branches": {"voxel": "0.01"}, "crown": {"face": "128"}},
    versions=package_versions(),
)


def write(folder, provenance):
    folder.mkdir()
    return write_plant_asset(
        folder, "oak", provenance=provenance, asset_from_capture=np.eye(4), foliage=some_leaves(2, "bezier")
    )


def test_all_inputs_are_in_the_file_and_one_digest_in_the_layer(tmp_path):
    asset = write(tmp_path / "oak", FULL)
    record = Sdf.Layer.FindOrOpen(str(asset)).customLayerData[CUSTOM_DATA_KEY]
    assert record["inputSha256"] == combined_sha256(INPUTS)
    assert record["inputCount"] == 100
    assert record["versions"]["numpy"] == np.__version__
    assert "images/" not in asset.read_text()
    written = json.loads((asset.parent / record["provenance"]).read_text())
    assert written["inputs"] == INPUTS
    assert list(written["inputs"]) == sorted(INPUTS)
    assert written["stages"] == FULL.stages


def test_it_is_read_again(tmp_path):
    asset = write(tmp_path / "oak", FULL)
    stage = open_asset(asset)
    assert read_plant_facts(require_plant(stage, asset), asset).provenance == FULL


def test_one_input_needs_no_file(tmp_path):
    asset = write(tmp_path / "oak", RUN)
    assert not (asset.parent / "report").exists()


def test_the_digest_is_that_of_sha256sum_and_not_of_the_order():
    lines = "".join(f"{INPUTS[name]}  {name}\n" for name in sorted(INPUTS))
    assert combined_sha256(INPUTS) == hashlib.sha256(lines.encode()).hexdigest()
    assert combined_sha256(dict(reversed(INPUTS.items()))) == combined_sha256(INPUTS)


@pytest.mark.parametrize("name", ["/home/somebody/a.jpg", "../a.jpg", "C:\\a.jpg", ""])
def test_an_input_that_names_a_machine_is_refused(name):
    with pytest.raises(ValueError, match="path from the capture's folder"):
        Provenance(capture="a", generator="test", seed=0, input_sha256="", inputs={name: "00"})


def test_what_is_not_installed_has_no_version():
    assert package_versions(("no-such-package-here",)) == {}
