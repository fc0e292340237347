"""The task that makes the whole asset of a tree of one photograph and the strokes over it."""

import tempfile
from dataclasses import replace
from pathlib import Path

from usdfoliage.asset.packages.plant_package import PlantAssetSettings
from usdfoliage.branch.foliage.species import GENERIC, load_species
from usdfoliage.branch.motion.rig import RigSettings
from usdfoliage.branch.motion.sway import SwaySettings
from usdfoliage.jobs.branches.motion import BranchMotion
from usdfoliage.jobs.plant.asset_facts import AssetFacts, write_asset_facts
from usdfoliage.jobs.plant.call import StageCall
from usdfoliage.jobs.plant.settings import SketchStageSettings
from usdfoliage.jobs.plant.stages.assemble import ASSET_FOLDER, provenance_of
from usdfoliage.jobs.plant.stages.asset_pictures import AssetDrawing
from usdfoliage.jobs.plant.stages.models import REPORT_FOLDER
from usdfoliage.jobs.plant.stages.parts import known_species, remark_unknown_species
from usdfoliage.jobs.plant.store import ResultFile
from usdfoliage.jobs.plant.summary import StagePicture, StageSummary, write_summary
from usdfoliage.jobs.sketch.model import HAS_LEAVES, SketchModelSettings
from usdfoliage.jobs.sketch.report import PICTURES
from usdfoliage.jobs.sketch.run import SketchRequest, TreeFolders, read_sketch_input, write_tree
from usdfoliage.leaf.model import count_origins
from usdfoliage.remarks import Remark, Setting
from usdfoliage.sketch.choices import SketchChoices

_OWN = {
    "branches.max_faces": "sketch.max_faces",
    "foliage.max_leaves": "sketch.max_leaves",
    "foliage.leaf_length_m": "sketch.leaf_length_m",
}


def sketch_plant(call: StageCall) -> tuple[ResultFile, ...]:
    """The asset of the tree, as usdfoliage sketch makes it, and its report.

    Raises:
        FoliageError: The photograph or the strokes cannot be used.
    """
    request = _request(call)
    given = read_sketch_input(request)
    number = call.settings.sketch.tree or 1
    given = replace(given, strokes=replace(given.strokes, trees=(given.strokes.trees[number - 1],)))
    with tempfile.TemporaryDirectory(prefix="usdfoliage-thumbnail-", dir=call.out) as work:
        drawing = AssetDrawing(settings=call.settings.pictures, folder=Path(work))
        folders = TreeFolders(asset=call.out / ASSET_FOLDER, report=call.out / REPORT_FOLDER)
        folders.asset.mkdir()
        tree = write_tree(
            folders,
            request,
            given,
            provenance_of(call),
            written=PlantAssetSettings(version=call.settings.plant.version),
            pictures=drawing.draw,
            progress=call.progress,
        )
    foliage = tree.model.foliage
    facts = AssetFacts(
        leaves=0 if foliage is None else len(foliage.leaves),
        foliage="none" if foliage is None else "species",
        branches=len(tree.model.branches.skeleton.skeleton),
        shape=drawing.shapes[0],
        origins={} if foliage is None else count_origins(foliage.leaves),
        is_drawable=not drawing.is_late,
    )
    write_asset_facts(call.out, facts)
    undrawn = bool(drawing.remarks) or (request.preview and not tree.drawn.sides)
    remarks = [*tree.remarks, *drawing.remarks, *remark_unknown_species(call.settings.plant.species)]
    write_summary(
        call.out,
        StageSummary(
            rows=tree.rows,
            remarks=[_as_sketch(each) for each in remarks],
            pictures=[StagePicture(file=f"{REPORT_FOLDER}/{file}", caption=title) for file, title in PICTURES.items()],
            detail=f"{REPORT_FOLDER}/index.html",
            poor=undrawn,
        ),
    )
    return ()


def _request(call: StageCall) -> SketchRequest:
    settings, plant = call.settings.sketch, call.settings.plant
    known = known_species(plant.species) if plant.species else None
    photo = call.inputs.photo
    assert photo is not None
    motion = BranchMotion(growth_frames=plant.growth_frames)
    if plant.sway_frames:
        sway = SwaySettings(frames=plant.sway_frames)
        motion = replace(motion, rig=RigSettings(), sway=sway, sway_clips=plant.sway_clips)
    # What is as by default leaves the choice to the strokes.
    default = SketchStageSettings()
    given = {
        name: value
        for name in ("height_m", "depth", "density", "gravity", "leaf_length_m")
        if (value := getattr(settings, name)) != getattr(default, name)
    }
    return SketchRequest(
        photo=photo,
        output=call.out,
        name=call.request.name,
        strokes=call.inputs.strokes,
        species=plant.species,
        settings=SketchModelSettings(
            species=known or load_species(GENERIC),
            max_leaves=settings.max_leaves,
            max_faces=settings.max_faces,
            has_leaves=HAS_LEAVES[settings.leaves],
            has_crown=settings.crown,
            representations=plant.representations,
            motion=motion,
        ),
        choices=SketchChoices(**given, seed=call.settings.seed or None),
        preview=call.settings.pictures.make,
        times=False,
    )


def _as_sketch(about: Remark) -> Remark:
    """A remark whose remedy names the settings of a sketch, where a plant of a capture has others."""
    if about.code == "leaves-broad":  # a build takes no leaf beside its photograph
        return replace(about, remedy=("name ", Setting(name="plant.species")))
    return replace(
        about,
        remedy=tuple(
            replace(part, name=_OWN.get(part.name, part.name)) if isinstance(part, Setting) else part
            for part in about.remedy
        ),
    )
