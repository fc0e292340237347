"""A build that stops after a part leaves an asset of that part, which opens."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from pxr import Usd
from usdfoliage.asset.asset_record import foreign_files, is_asset_folder
from usdfoliage.asset.packages.contents import interface_of, read_plant_facts
from usdfoliage.asset.validation.validate import validate_asset
from usdfoliage.branch.cage.build import build_branch_cage
from usdfoliage.branch.cage.surfaces import BranchSurfaces
from usdfoliage.branch.model_file import BranchesModel, TracedPlant, write_branches_model, write_traced_plant
from usdfoliage.crown.model_file import MadeCrown, write_crown_model
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.plant.stages.part_asset import write_part_asset
from usdfoliage.jobs.plant.summary import read_summary
from usdfoliage.leaf.model_file import LeavesModel, write_leaves_model

from tests.support.branch_shapes import fork
from tests.support.leaves.assets import two_leaves
from tests.support.plant_assets import round_crown

FRAME = np.array([[1.0, 0, 0, 2], [0, 0, 1, 0.5], [0, -1, 0, 0], [0, 0, 0, 1]])


def write_model(part: str, folder: Path) -> None:
    """What the stage of that part leaves."""
    (folder / "report").mkdir(parents=True)
    (folder / "report" / "index.html").write_text("a page")
    if part == "leaves":
        cv2.imwrite(str(folder / "average_leaf.png"), np.full((8, 8, 4), 128, np.uint8))
        model = LeavesModel(leaves=two_leaves(), asset_from_capture=FRAME, texture_color=(0.1, 0.2, 0.1))
        write_leaves_model(folder / "leaves.npz", model)
    elif part == "crown":
        crown = replace(round_crown(), asset_from_photo=FRAME)
        write_crown_model(folder / "crown.npz", MadeCrown(model=crown, overlap=0.8))
    else:
        skeleton = fork()
        surfaces = BranchSurfaces(whole=build_branch_cage(skeleton))
        branches = BranchesModel(skeleton=skeleton, surfaces=surfaces, color=(0.2, 0.1, 0.05))
        write_branches_model(folder / "branches.npz", branches)
        write_traced_plant(
            folder / "plant.npz",
            TracedPlant(
                points_m=skeleton.points_m,
                wood=np.ones(len(skeleton.points_m), bool),
                knows_leaves=False,
                colors=None,
                plant_from_capture=FRAME,
                skeleton=skeleton,
            ),
        )


def call_for(part: str, folder: Path) -> SimpleNamespace:
    (folder / "out").mkdir()
    return SimpleNamespace(
        out=folder / "out",
        inputs=SimpleNamespace(name="fern", source=Path("fern"), digests=(("images/1.jpg", "00" * 32),)),
        settings=BuildSettings(),
        request=SimpleNamespace(name="fern", capture=Path("fern")),
        task=SimpleNamespace(needs=(part,)),
        has=lambda name: name == part,
        result_of=lambda name: folder / name,
    )


@pytest.mark.parametrize(
    ("part", "prim"),
    [("leaves", "geo/render/Leaves"), ("branches", "geo/render/Branches"), ("crown", "geo/proxy/Crown")],
)
def test_a_part_alone_is_an_asset(tmp_path, part, prim):
    write_model(part, tmp_path / part)
    call = call_for(part, tmp_path)
    write_part_asset(call)  # type: ignore[arg-type]
    asset = call.out / "asset"
    assert is_asset_folder(asset)
    assert foreign_files(asset) == []
    interface, _ = interface_of(asset)
    stage = Usd.Stage.Open(str(interface))
    plant = stage.GetDefaultPrim()
    assert stage.GetPrimAtPath(f"/fern/{prim}").IsDefined()
    facts = read_plant_facts(plant, interface)
    assert np.array_equal(facts.asset_from_capture, FRAME)
    assert facts.provenance.inputs == {"images/1.jpg": "00" * 32}
    assert (asset / "report" / "index.html").read_text() == "a page"
    assert (asset / "maps" / "fern_leaf.png").is_file() == (part == "leaves")
    assert [each for each in validate_asset(asset).findings if each.severity == "error"] == []
    assert read_summary(call.out).failure == ""


@pytest.mark.parametrize("part", ["leaves", "branches", "crown"])
def test_a_part_that_could_not_be_made_has_none(tmp_path, part):
    (tmp_path / part).mkdir()
    call = call_for(part, tmp_path)
    write_part_asset(call)  # type: ignore[arg-type]
    assert not (call.out / "asset").exists()
    assert read_summary(call.out).remarks == ()
