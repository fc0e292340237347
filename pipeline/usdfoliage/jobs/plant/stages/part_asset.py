"""The task that writes one part of a plant into an asset of its own, for those who stop a build after that part."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.packages.assembly import Origin, begin_asset, write_asset
from usdfoliage.asset.parts.branch_part import write_branch_part
from usdfoliage.asset.parts.crown_part import write_crown_part
from usdfoliage.asset.parts.leaf_part import BranchLeaves, LeafAssetSettings, write_leaf_part
from usdfoliage.asset.parts.part import PartWriter
from usdfoliage.asset.publish import publish_folder
from usdfoliage.jobs.plant.call import StageCall
from usdfoliage.jobs.plant.stages.assemble import ASSET_FOLDER, provenance_of
from usdfoliage.jobs.plant.stages.models import (
    LEAVES_MODEL,
    REPORT_FOLDER,
    appearance_of,
    read_crown,
    read_plant_branches,
    read_traced,
)
from usdfoliage.jobs.plant.store import ResultFile, copy_tree
from usdfoliage.jobs.plant.summary import StageSummary, write_summary
from usdfoliage.jobs.plant.tasks import BRANCHES, CROWN, LEAVES
from usdfoliage.leaf.model_file import read_leaves_model

Frame = NDArray[np.float64] | None  # (4, 4), column vectors, from the capture's coordinates


def write_part_asset(call: StageCall) -> tuple[ResultFile, ...]:
    """The asset of the part that the task needs, in the part's own frame; none where the part could not be made."""
    (stage,) = call.task.needs
    made = call.result_of(stage)
    frame, write = READERS[stage](call, made)
    if write is not None:
        origin = Origin(provenance=provenance_of(call), asset_from_capture=frame, version=call.settings.plant.version)
        with publish_folder(call.out / ASSET_FOLDER) as folder:
            place = begin_asset(folder, call.request.name)
            copy_tree(made / REPORT_FOLDER, folder / "report")
            write_asset(place, [write(place)], origin)
    write_summary(call.out, StageSummary())
    return ()


def _read_leaves(call: StageCall, made: Path) -> tuple[Frame, PartWriter | None]:
    if not (made / LEAVES_MODEL).is_file():
        return None, None
    model = read_leaves_model(made / LEAVES_MODEL)
    settings = LeafAssetSettings(representations=("bezier",))
    foliage = BranchLeaves(leaves=model.leaves, settings=settings, appearance=appearance_of(model, made))
    return model.asset_from_capture, lambda place: write_leaf_part(place, foliage)


def _read_branches(call: StageCall, made: Path) -> tuple[Frame, PartWriter | None]:
    branches, traced = read_plant_branches(made), read_traced(made)
    if branches is None or traced is None:
        return None, None
    return traced.plant_from_capture, lambda place: write_branch_part(place, branches)


def _read_crown(call: StageCall, made: Path) -> tuple[Frame, PartWriter | None]:
    crown = read_crown(made)
    if crown is None:
        return None, None
    mesh_size = call.settings.crown.mesh_size
    return crown.model.asset_from_photo, lambda place: write_crown_part(place, crown.model, mesh_size)


# Frame and writer of each part in the result of its stage; no writer where it could not be made.
READERS: Mapping[str, Callable[[StageCall, Path], tuple[Frame, PartWriter | None]]] = {
    LEAVES: _read_leaves,
    BRANCHES: _read_branches,
    CROWN: _read_crown,
}
