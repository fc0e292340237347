"""The public Python interface: what `__all__` lists is the promise of the version, the rest of the package may change.

Arrays are numpy's, lengths metres, angles radians, colours linear Rec.709; an asset's frame is right-handed with Y up.
Models are frozen dataclasses: a change makes another one (`dataclasses.replace`, `Leaves.take`), and no function
changes an array that it is given. A path is a text or a `pathlib.Path`. What the user's data can cause is a
FoliageError. The page docs/python_api.md has examples.
"""

from usdfoliage.api.building import BuildResult, build, read_plan
from usdfoliage.api.evaluation import leaf_mesh, leaf_normals, leaf_points
from usdfoliage.api.opening import open_asset, validate
from usdfoliage.api.scattering import scatter_leaves
from usdfoliage.api.writing import WrittenAsset, bake, write_asset, write_look
from usdfoliage.asset.parts.leaf_part import LeafAppearance
from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.validation.findings import Finding
from usdfoliage.asset.validation.validate import ValidationReport
from usdfoliage.branch.model import Skeleton
from usdfoliage.crown.model import CrownModel
from usdfoliage.errors import AssetError, CaptureError, FitError, FoliageError
from usdfoliage.jobs.models import AssetModels
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.leaf.change import bake_leaves, join_leaves, move_leaves
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.edits import NEUTRAL, LeafEdits, compose_edits, invert_edits
from usdfoliage.leaf.shape.mesh import LeafMesh, LeafMeshSettings
from usdfoliage.leaf.shape.spray import SpraySettings
from usdfoliage.leaf.shape.variation import VariationSettings
from usdfoliage.remarks import Argument, Remark, Setting

__all__ = [
    "NEUTRAL",
    "Argument",
    "AssetError",
    "AssetModels",
    "BuildResult",
    "BuildSettings",
    "CaptureError",
    "CrownModel",
    "Finding",
    "FitError",
    "FoliageError",
    "LeafAppearance",
    "LeafEdits",
    "LeafMesh",
    "LeafMeshSettings",
    "Leaves",
    "Provenance",
    "Remark",
    "Setting",
    "Skeleton",
    "SpraySettings",
    "ValidationReport",
    "VariationSettings",
    "WrittenAsset",
    "bake",
    "bake_leaves",
    "build",
    "compose_edits",
    "invert_edits",
    "join_leaves",
    "leaf_mesh",
    "leaf_normals",
    "leaf_points",
    "move_leaves",
    "open_asset",
    "read_plan",
    "scatter_leaves",
    "validate",
    "write_asset",
    "write_look",
]
