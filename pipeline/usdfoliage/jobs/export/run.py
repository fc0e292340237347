"""An asset, with a look and its edits, as files for another application."""

import json
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from pxr import Kind, Sdf, Usd, UsdGeom, UsdSkel

from usdfoliage import __version__
from usdfoliage.asset.export.arkit_rules import check_arkit
from usdfoliage.asset.export.both_sides import author_both_sides
from usdfoliage.asset.export.files import gather_files
from usdfoliage.asset.export.flat import finish_root, flatten_plant, select_variants
from usdfoliage.asset.export.materials import keep_networks, settle_colors
from usdfoliage.asset.export.nanite import KIND, AssemblyRig, author_assembly, wind_data
from usdfoliage.asset.export.package import pack_usdz, plan_package, publish_package, record_origin
from usdfoliage.asset.export.plain_rules import check_plain
from usdfoliage.asset.export.polygons import polygonize_meshes
from usdfoliage.asset.export.repeated_leaves import RepeatedLeaves, author_repeated_leaves
from usdfoliage.asset.export.unreal_rules import check_unreal
from usdfoliage.asset.layer import save_layer
from usdfoliage.asset.locate import find_leaves
from usdfoliage.asset.looks.look import open_asset
from usdfoliage.asset.materials.layer import LEAF_MATERIAL
from usdfoliage.asset.own_files import own_folders
from usdfoliage.asset.packages.contents import find_skeleton, read_leaf_appearance, read_plant_facts, require_plant
from usdfoliage.asset.parts.branches import read_skeleton
from usdfoliage.asset.parts.leaf_part import leaf_jitter
from usdfoliage.asset.parts.leaves import read_leaves
from usdfoliage.asset.plant import BRANCHES, CROWN, LEAVES
from usdfoliage.asset.provenance import Provenance, author_provenance
from usdfoliage.asset.publish import plan_folder, publish_folder
from usdfoliage.asset.validation.findings import Finding
from usdfoliage.errors import AssetError
from usdfoliage.files.temporary_folder import temporary_folder
from usdfoliage.jobs.edits.bake import BakeRequest, bake_asset, read_bake_input
from usdfoliage.jobs.export.joints import rig_assembly
from usdfoliage.jobs.export.request import STANDALONE, UNREAL, USDZ, ExportPlan, ExportRequest, plan_output
from usdfoliage.jobs.report.table import Row
from usdfoliage.leaf.shape.groups import group_leaves
from usdfoliage.leaf.shape.mesh import LeafMeshSettings
from usdfoliage.progress import StepProgress
from usdfoliage.remarks import Argument, Remark, RenderSetting, as_plan_setting, label_remarks, remark

COMPONENT = Kind.Tokens.component
# What a bake reports of the asset that it writes, which nobody gets here.
_OF_BAKES = ("leaf-motion-lost", "trunk-shown-with-crown", "look-acts-twice", "jitter-stays-edit")


@dataclass(frozen=True, kw_only=True)
class ExportedAsset:
    """What was written, and what the user should know of it."""

    asset: Path
    facts: tuple[Row, ...]
    remarks: tuple[Remark, ...]


def export_asset(request: ExportRequest, progress: StepProgress | None = None) -> ExportedAsset:
    """Write an export; what was there stays until the new one is whole and keeps the rules of its profile.

    Raises:
        FoliageError: The asset is none that can be exported, or the output cannot be written; nothing was changed.
    """
    plan = plan_output(request, __version__)
    with _publish(request, plan) as folder, temporary_folder("export", AssetError) as scratch:
        interface, remarks = _bake(request, plan, scratch, progress)
        if progress:
            progress("write", 0.6)
        stage = open_asset(interface)
        plant = require_plant(stage, request.asset)
        select_variants(plant, plan.lod, "bezier" if request.repeats_leaves else "mesh")
        leaves = _read_leaves(request, plant, interface) if request.repeats_leaves else None
        flat = flatten_plant(plant, plan.name, keep_skeleton=request.profile == STANDALONE)
        remarks += _shape_plant(request, flat, plant, leaves, folder)
        remarks += _shade_plant(request, flat)
        gather_files(
            flat,
            interface.resolve().parent,
            folder,
            for_ar=request.is_package,
            only_shading=request.profile != STANDALONE,
        )
        finish_root(flat.GetDefaultPrim(), f"{plan.name}.usdc", KIND if request.profile == UNREAL else COMPONENT)
        _record(request, plan, flat.GetRootLayer(), read_plant_facts(plant, interface).provenance)
        layer = folder / f"{plan.name}.usdc"
        save_layer(flat.GetRootLayer(), layer)
        if request.is_package:
            pack_usdz(layer, folder / plan.file)
        if progress:
            progress("check", 0.9)
        _require_rules(request, folder / plan.file)
        facts = _count(flat)
    asset = request.output if request.is_package else request.output / plan.file
    return ExportedAsset(asset=asset, facts=tuple(facts), remarks=tuple(remarks))


def plan_export(request: ExportRequest, render: RenderSetting = as_plan_setting) -> str:
    """What export_asset would do, in lines, after reading the asset; writes nothing. render: of settings in remarks."""
    plan = plan_output(request, __version__)
    lines, remarks = [f"profile: {request.profile}"], list[Remark]()
    if plan.has_leaves:
        given = read_bake_input(_bake_request(request, request.output / plan.name, plan.name))
        remarks = [each for each in given.remarks if each.code not in _OF_BAKES]
        lines.append(f"leaves: {len(given.leaves):,}")
    lines += label_remarks(remarks, render)
    if request.is_package:
        lines.append(plan_package(request.output, plan.origin, force=request.force))
    else:
        lines.append(
            plan_folder(request.output, plan.file, request.force, origin=plan.origin, keep_old=request.keep_old)
        )
    return "\n".join(lines)


def _publish(request: ExportRequest, plan: ExportPlan) -> AbstractContextManager[Path]:
    if request.is_package:
        return publish_package(request.output, plan.origin, force=request.force)
    return publish_folder(request.output, force=request.force, origin=plan.origin, keep_old=request.keep_old)


def _bake(
    request: ExportRequest, plan: ExportPlan, scratch: Path, progress: StepProgress | None
) -> tuple[Path, list[Remark]]:
    """The interface of an asset that has the edits of leaves in it, the given one where there are no leaves."""
    if not plan.has_leaves:
        return plan.source.interface, []
    in_bake = None if progress is None else partial(_report_bake, progress)
    baked = bake_asset(_bake_request(request, scratch / plan.name, plan.name), in_bake)
    return baked.asset, [each for each in baked.remarks if each.code not in _OF_BAKES]


def _report_bake(progress: StepProgress, step: str, share: float) -> None:
    progress("bake", 0.6 * share)


def _bake_request(request: ExportRequest, output: Path, name: str) -> BakeRequest:
    return BakeRequest(
        asset=request.asset,
        output=output,
        name=name,
        representations=("bezier", "mesh"),
        resolution=request.resolution,
        source="bezier",
    )


def _read_leaves(request: ExportRequest, plant: Usd.Prim, interface: Path) -> RepeatedLeaves | None:
    prims = find_leaves(plant.GetStage())
    if not prims:
        return None
    read = read_leaves(prims[0])
    appearance = read_leaf_appearance(prims[0], read.jitter_map, own_folders(interface))
    across, along = request.resolution or (LeafMeshSettings().across, LeafMeshSettings().along)
    return RepeatedLeaves(
        leaves=read.leaves,
        groups=group_leaves(read.leaves, request.settings.shapes),
        color=appearance.color,
        jitter=leaf_jitter(read.edits, appearance),
        mesh=LeafMeshSettings(across=across, along=along),
    )


def _shape_plant(
    request: ExportRequest, flat: Usd.Stage, plant: Usd.Prim, leaves: RepeatedLeaves | None, folder: Path
) -> list[Remark]:
    """Give the plant the geometry of the profile, and write what goes beside it."""
    remarks = []
    root = flat.GetDefaultPrim().GetPath()
    coarse = polygonize_meshes(flat, request.settings.max_cage_faces, fine=[root.AppendPath(CROWN)])
    if coarse:
        text = f"more than {request.settings.max_cage_faces:,} faces, which were not refined: {', '.join(coarse)}"
        remarks.append(remark("surface-not-refined", text))
    if request.has_both_sides:
        author_both_sides(flat)
    if request.profile == UNREAL:
        rigged = _find_joints(flat, plant, leaves)
        if rigged is None:
            remarks.append(remark("assembly-without-joints", "the plant has no branches, so its parts do not move"))
        else:
            text = json.dumps(wind_data(rigged.rig, rigged.order), indent=1)
            (folder / f"{root.name}_wind.json").write_text(text + "\n", encoding="utf-8")
        author_assembly(flat, root, rigged, leaves)
    elif leaves is not None:
        flat.RemovePrim(root.AppendPath(LEAVES))
        author_repeated_leaves(flat, root.AppendPath(LEAVES), leaves, root.AppendPath(LEAF_MATERIAL))
    if leaves is not None and len(leaves.groups) < len(leaves.leaves):
        away_mm = 1000 * leaves.groups.away * leaves.leaves.length_m
        text = (
            f"{len(leaves.leaves):,} leaves have {len(leaves.groups)} shapes, from their own by "
            f"{np.median(away_mm):.2g} mm (median) and {away_mm.max():.2g} mm (largest)"
        )
        remedy = (Argument(name="shapes"), " allows more shapes")
        remarks.append(remark("leaf-shapes-repeated", text, remedy=remedy))
    return remarks


def _find_joints(flat: Usd.Stage, plant: Usd.Prim, leaves: RepeatedLeaves | None) -> AssemblyRig | None:
    wood = flat.GetPrimAtPath(flat.GetDefaultPrim().GetPath().AppendPath(BRANCHES))
    skeleton = find_skeleton(plant)
    if not wood or skeleton is None:
        return None
    base_m = leaves.leaves.base_m if leaves is not None else np.zeros((0, 3))
    return rig_assembly(read_skeleton(skeleton), wood, base_m)


def _shade_plant(request: ExportRequest, flat: Usd.Stage) -> list[Remark]:
    """Leave the materials that the profile's applications know."""
    if request.profile == STANDALONE:
        # Leaves shine through in MaterialX alone. Of bark and crowns it has no more than UsdPreviewSurface, and Storm
        # draws a crown's in minutes without a GPU.
        keep_networks(flat, [flat.GetDefaultPrim().GetPath().AppendPath(LEAF_MATERIAL)])
        return []
    keep_networks(flat)
    several = settle_colors(flat)
    keep_networks(flat)  # without what read the colours
    if not several:
        return []
    text = f"colours of single leaves or faces are left out: {', '.join(several)} has their mean"
    return [remark("colors-averaged", text)]


def _record(request: ExportRequest, plan: ExportPlan, layer: Sdf.Layer, provenance: Provenance) -> None:
    described = {"export-profile": request.profile, "export-lod": plan.lod}
    if request.repeats_leaves:
        described["export-shapes"] = str(request.settings.shapes)
    if request.has_both_sides:
        described["export-sides"] = "2"
    generator = f"usdfoliage {__version__}"
    settings = {**provenance.settings, **described}
    author_provenance(layer, replace(provenance, generator=generator, settings=settings, inputs={}, stages={}))
    if request.is_package:
        record_origin(layer, plan.origin)


def _require_rules(request: ExportRequest, written: Path) -> None:
    """Raises AssetError where an export breaks a rule of its profile, so that none does."""
    broken = check_export(written, request.profile, instances=request.settings.leaves == "instances")
    if broken:
        more = f" and {len(broken) - 1} more" if len(broken) > 1 else ""
        first = f"{broken[0].path} {broken[0].message}"
        raise AssetError(
            f"the export of {request.asset} breaks a rule of {request.profile}: {first}{more}",
            "export another lod, or bake the asset into another folder and export that",
        )


def check_export(path: Path, profile: str, *, instances: bool = False) -> list[Finding]:
    """What a file breaks of the rules of a profile.

    Args:
        path: The .usdc or .usdz.
        profile: One of PROFILES.
        instances: Whether a standalone file may have a PointInstancer.
    """
    if profile == USDZ:
        return check_arkit(path)
    stage = Usd.Stage.Open(str(path))
    return check_unreal(stage) if profile == UNREAL else check_plain(stage, instances=instances)


def _count(flat: Usd.Stage) -> list[Row]:
    """What an export holds."""
    meshes = [UsdGeom.Mesh(prim) for prim in flat.Traverse() if prim.IsA(UsdGeom.Mesh)]
    triangles = sum(int((np.array(mesh.GetFaceVertexCountsAttr().Get()) - 2).sum()) for mesh in meshes)
    rows = [Row(name="meshes", value=f"{len(meshes):,}"), Row(name="triangles", value=f"{triangles:,}")]
    for prim in flat.Traverse():
        instancer, skeleton = UsdGeom.PointInstancer(prim), UsdSkel.Skeleton(prim)
        if instancer:
            count, shapes = len(instancer.GetProtoIndicesAttr().Get() or ()), instancer.GetPrototypesRel().GetTargets()
            rows += [Row(name="instances", value=f"{count:,}"), Row(name="shapes", value=f"{len(shapes):,}")]
        elif skeleton and len(skeleton.GetJointsAttr().Get() or ()) > 1:
            rows.append(Row(name="joints", value=f"{len(skeleton.GetJointsAttr().Get()):,}"))
    return rows
