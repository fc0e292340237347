"""The model files that the stages of a plant's parts hand on, in the folders of their results."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.parts.branch_part import BranchAssetSettings, PlantBranches
from usdfoliage.asset.parts.branches import SkeletonPrim
from usdfoliage.asset.parts.leaf_part import LeafAppearance
from usdfoliage.branch.model_file import BranchesModel, TracedPlant, read_branches_model, read_traced_plant
from usdfoliage.crown.leaf_colors import find_green_points
from usdfoliage.crown.model_file import MadeCrown, read_crown_model
from usdfoliage.jobs.fitted_leaves import FittedLeaves
from usdfoliage.leaf.model_file import LeavesModel, read_leaves_model
from usdfoliage.leaf.shape.edits import NEUTRAL

BRANCHES_MODEL = "branches.npz"  # what is drawn of the branches
PLANT_POINTS = "plant.npz"  # the cloud as branches were traced through it
VARIATION_MODEL = "variation_{number:02d}.npz"  # the same of a further plant
LEAVES_MODEL = "leaves.npz"
AVERAGE_LEAF = "average_leaf.png"  # where the leaves have one
CROWN_MODEL = "crown.npz"
REPORT_FOLDER = "report"  # of the stage alone


@dataclass(frozen=True, kw_only=True, eq=False)
class CapturedLeaves:
    """Leaves that were found in photographs, in their own frame."""

    fitted: FittedLeaves
    own_from_capture: NDArray[np.float64]  # (4, 4), column vectors, from the capture's coordinates
    certainty: NDArray[np.float64] | None = None  # (N,), 0.5 to 1, the probability that the base is the base


def read_captured_leaves(folder: Path) -> CapturedLeaves | None:
    """The leaves in the result of the stage leaves; None where none were found.

    Raises:
        CaptureError: The file cannot be read.
    """
    if not (folder / LEAVES_MODEL).is_file():
        return None
    model = read_leaves_model(folder / LEAVES_MODEL)
    if not len(model.leaves):
        return None
    fitted = FittedLeaves(leaves=model.leaves, edits=NEUTRAL, appearance=appearance_of(model, folder))
    return CapturedLeaves(fitted=fitted, own_from_capture=model.asset_from_capture, certainty=model.certainty)


def appearance_of(model: LeavesModel, folder: Path) -> LeafAppearance:
    """What the leaves in a result have in common."""
    texture = folder / AVERAGE_LEAF if model.texture_color is not None else None
    appearance = LeafAppearance(texture=texture, texture_color=model.texture_color)
    return appearance if model.plain_color is None else replace(appearance, color=model.plain_color)


def read_leaf_frame(folder: Path) -> NDArray[np.float64] | None:
    """(4, 4) for column vectors, from the capture's coordinates to those of the leaves in the result of their stage;
    None where leaves could not be looked for.

    Raises:
        CaptureError: The file cannot be read.
    """
    path = folder / LEAVES_MODEL
    return read_leaves_model(path).asset_from_capture if path.is_file() else None


def read_traced(folder: Path) -> TracedPlant | None:
    """The cloud in the result of the stage branches; None where no branches could be traced.

    Raises:
        CaptureError: The file cannot be read.
    """
    path = folder / PLANT_POINTS
    return read_traced_plant(path) if path.is_file() else None


def leafy_points(traced: TracedPlant) -> NDArray[np.bool_]:
    """(N,), which points of the cloud are of leaves, as far as that is known.

    Where stems are of photographs, the cloud was not divided: what is not on a stem may be of a wall as well, and
    points that are not green are left out, where green ones can be distinguished.
    """
    leafy = ~traced.wood
    if traced.of_photographs and traced.colors is not None:
        green = find_green_points(traced.points_m, traced.colors)
        if green is not None:
            leafy &= green
    return leafy


def read_plant_branches(folder: Path) -> PlantBranches | None:
    """What is drawn of the branches in the result of their stage; None where none could be traced.

    Raises:
        CaptureError: The file cannot be read.
    """
    path = folder / BRANCHES_MODEL
    return drawn_branches(read_branches_model(path)) if path.is_file() else None


def read_variation(folder: Path, number: int) -> PlantBranches | None:
    """What is drawn of the branches of a further plant, from 1 on, in the result of the stage of branches; None where
    it could not be made.

    Raises:
        CaptureError: The file cannot be read.
    """
    path = folder / VARIATION_MODEL.format(number=number)
    return drawn_branches(read_branches_model(path)) if path.is_file() else None


def drawn_branches(model: BranchesModel) -> PlantBranches:
    """Branches as an asset writes them."""
    return PlantBranches(
        skeleton=SkeletonPrim(skeleton=model.skeleton, growth=model.growth),
        surfaces=model.surfaces,
        settings=BranchAssetSettings(color=model.color),
    )


def read_crown(folder: Path) -> MadeCrown | None:
    """The crown in the result of its stage; None where none could be made.

    Raises:
        CaptureError: The file cannot be read.
    """
    path = folder / CROWN_MODEL
    return read_crown_model(path) if path.is_file() else None
