"""Variant sets of the payload: which layers a selection opens, sets inside variants of another."""

from pathlib import Path

import pytest
from pxr import Sdf, Usd
from usdfoliage.asset.packages.interface import write_payload_layer
from usdfoliage.asset.variants import VariantSet, author_variant_sets

LAYERS = ("wood", "bezier", "mesh", "crown")
SETS = [
    VariantSet(
        name="lod",
        variants={"leaves": ["./wood.usda"], "both": ["./wood.usda", "./crown.usda"], "crown": ["./crown.usda"]},
    ),
    VariantSet(
        name="representation",
        variants={"bezier": ["./bezier.usda"], "mesh": ["./mesh.usda"]},
        inside=["leaves", "both"],
    ),
]


@pytest.fixture
def tree(tmp_path):
    """A stage of a plant whose payload has SETS, one prim a layer."""
    for name in LAYERS:
        layer = Usd.Stage.CreateNew(str(tmp_path / f"{name}.usda"))
        layer.SetDefaultPrim(layer.DefinePrim("/tree"))
        layer.DefinePrim(f"/tree/{name}")
        layer.Save()
    write_payload_layer(tmp_path / "payload.usda", "tree", [], SETS)
    stage = Usd.Stage.CreateNew(str(tmp_path / "tree.usda"))
    prim = stage.DefinePrim("/tree")
    author_variant_sets(stage, Sdf.Path("/tree"), SETS)
    prim.GetPayloads().AddPayload("./payload.usda")
    return stage


def test_the_first_variants_are_selected(tree):
    assert tree.GetPrimAtPath("/tree").GetVariantSets().GetAllVariantSelections() == {
        "lod": "leaves",
        "representation": "bezier",
    }


@pytest.mark.parametrize(
    ("lod", "representation", "wanted"),
    [
        ("leaves", "bezier", {"wood", "bezier"}),
        ("leaves", "mesh", {"wood", "mesh"}),
        ("both", "mesh", {"wood", "crown", "mesh"}),
        ("crown", "bezier", {"crown"}),
    ],
)
def test_only_the_layers_of_the_selection_are_opened(tree, lod, representation, wanted):
    prim = tree.GetPrimAtPath("/tree")
    prim.GetVariantSets().SetSelection("lod", lod)
    prim.GetVariantSets().SetSelection("representation", representation)
    assert {child.GetName() for child in prim.GetChildren()} == wanted
    assert {Path(layer.realPath).stem for layer in tree.GetUsedLayers() if layer.realPath} & set(LAYERS) == wanted


def test_writing_opens_none_of_them(tmp_path):
    write_payload_layer(tmp_path / "payload.usda", "tree", [], SETS)  # the layers need not even be there
    assert not any(Sdf.Layer.Find(str(tmp_path / f"{name}.usda")) for name in LAYERS)
