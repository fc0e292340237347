"""Wood that is not in one piece is an error."""

from dataclasses import replace

import numpy as np
import pytest
from pxr import Usd, UsdGeom
from usdfoliage.asset.packages.branch_package import write_branch_asset
from usdfoliage.asset.parts.branches import SkeletonPrim
from usdfoliage.asset.validation.validate import validate_asset
from usdfoliage.asset.validation.wood import VALIDATOR, check_wood
from usdfoliage.branch.cage.build import build_branch_cage
from usdfoliage.branch.cage.surfaces import BranchSurfaces

from tests.support.branch_shapes import fork
from tests.support.leaves.assets import PROVENANCE


def write(folder, change=lambda cage: cage, skeleton=None):
    skeleton = skeleton or fork()
    cage = change(build_branch_cage(fork()))
    folder.mkdir()
    surfaces = BranchSurfaces(whole=cage, by_order=((1, build_branch_cage(fork().up_to_order(1))),))
    return write_branch_asset(folder, "oak", SkeletonPrim(skeleton=skeleton), surfaces, PROVENANCE, np.eye(4))


def doubled(cage):
    """The same surface twice, the second one 6 m beside."""
    points = len(cage.points_m)
    return replace(
        cage,
        points_m=np.concatenate([cage.points_m, cage.points_m + np.array([6.0, 0, 0])]),
        ring=np.concatenate([cage.ring, cage.ring + cage.ring.max() + 1]),
        faces=np.concatenate([cage.faces, cage.faces + points]),
        face_st=np.concatenate([cage.face_st, cage.face_st]),
        curve=np.concatenate([cage.curve, cage.curve]),
        order=np.concatenate([cage.order, cage.order]),
    )


def test_whole_wood_has_no_finding(tmp_path):
    report = validate_asset(write(tmp_path / "oak"))
    assert not [finding for finding in report.findings if finding.validator == VALIDATOR]


def test_a_piece_afloat_is_one_error_for_all_variants(tmp_path):
    report = validate_asset(write(tmp_path / "oak", doubled))
    (found,) = [finding for finding in report.findings if finding.validator == VALIDATOR]
    assert (found.severity, found.error, found.where) == ("error", "PieceAfloat", "")
    assert found.path == "/oak/geo/render/Branches"
    assert "1 of 2 pieces" in found.message
    assert report.open_errors == 1


def test_axes_without_surface_are_an_error(tmp_path):
    layer = write(tmp_path / "oak", lambda _: build_branch_cage(fork().up_to_order(1)))
    (found,) = check_wood(Usd.Stage.Open(str(layer)))
    assert found.error == "BareAxis"
    twig = np.sqrt(0.5) / (3 + np.sqrt(0.5))  # of the whole length
    assert float(found.message.split("%")[0]) == pytest.approx(100 * twig, abs=1)


@pytest.mark.parametrize("variant", ["order1"])
def test_variants_that_lack_branches_are_not_looked_at(tmp_path, variant):
    stage = Usd.Stage.Open(str(write(tmp_path / "oak")))
    stage.GetDefaultPrim().GetVariantSet("branches").SetVariantSelection(variant)
    assert check_wood(stage) is None


def test_a_mesh_that_is_broken_is_left_to_other_validators(tmp_path):
    stage = Usd.Stage.Open(str(write(tmp_path / "oak")))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/oak/geo/render/Branches"))
    mesh.GetFaceVertexIndicesAttr().Set([0, 1, 2, 10**6])
    assert check_wood(stage) is None
