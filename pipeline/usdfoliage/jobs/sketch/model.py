"""From a photograph in memory to all that a tree's asset is written from."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.parts.branch_part import BranchAssetSettings, PlantBranches
from usdfoliage.asset.parts.branches import SkeletonPrim
from usdfoliage.asset.parts.leaf_part import BranchLeaves
from usdfoliage.branch.foliage.species import GENERIC, Species, load_species
from usdfoliage.crown.model import CrownModel
from usdfoliage.errors import FitError
from usdfoliage.geometry.color import decode_srgb, encode_srgb
from usdfoliage.geometry.lines import arc_lengths, points_at
from usdfoliage.jobs.branches.foliage import GrownLeaves
from usdfoliage.jobs.branches.motion import BranchMotion, grow_near_leaves, rig_branches, rig_near_leaves
from usdfoliage.jobs.branches.surfaces import MIN_MAX_FACES, build_surfaces
from usdfoliage.jobs.crown.photograph import CrownSettings, reconstruct_crown
from usdfoliage.jobs.leaf_picture import GivenLeaf
from usdfoliage.jobs.sketch.leaves import SketchLeaves, grow_sketch_leaves
from usdfoliage.progress import StepProgress, follow_step
from usdfoliage.remarks import Remark, remark
from usdfoliage.sketch.choices import SketchChoices
from usdfoliage.sketch.foliage import Foliage
from usdfoliage.sketch.growth import Watch
from usdfoliage.sketch.reconstruct import SketchedTree, SketchSettings, sketch_tree
from usdfoliage.sketch.strokes import TreeStrokes

Floats = NDArray[np.float64]

WORK_PX = 1500  # longer side of the picture that a tree is made of, as in the paper; a larger photograph is shrunk
CROWN_SIZE = 128  # texels a side of its cubemaps
MAX_LEAVES = 1_000_000
HAS_LEAVES: Mapping[str, bool | None] = MappingProxyType({"auto": None, "on": True, "off": False})  # as users name it
MAX_LEAF_LENGTH_M = 10.0
MIN_DENSITY, MAX_DENSITY = 0.05, 4.0
_FEW_BARK = 3  # pixels of a stem, of which its colour is known


@dataclass(frozen=True, kw_only=True)
class SketchModelSettings:
    """Everything that decides what a photograph becomes."""

    tree: SketchSettings = field(default_factory=SketchSettings)
    species: Species = field(default_factory=lambda: load_species(GENERIC))
    leaf: GivenLeaf | None = None  # whose form and look the leaves have; None: that of the species
    leaf_length_m: float | None = None  # None: by the texture of the photograph
    density: float = 1.0  # times as many leaves as the species has
    max_leaves: int = 20_000
    has_leaves: bool | None = None  # None: where the photograph shows any
    has_crown: bool = True
    representations: tuple[str, ...] | None = None  # of the leaves; None: by their number
    max_faces: int = 200_000  # of the surface of branches
    motion: BranchMotion = field(default_factory=BranchMotion)

    def __post_init__(self) -> None:
        length_m = self.leaf_length_m
        if length_m is not None and not (math.isfinite(length_m) and 0 < length_m <= MAX_LEAF_LENGTH_M):
            limit = f"{MAX_LEAF_LENGTH_M:g}"
            raise ValueError(f"the leaf length must be above 0 and at most {limit} metres, not {length_m:g}")
        if self.max_faces < MIN_MAX_FACES:
            raise ValueError(f"max_faces must be at least {MIN_MAX_FACES}, not {self.max_faces}")
        if not MIN_DENSITY <= self.density <= MAX_DENSITY:
            raise ValueError(f"density must be {MIN_DENSITY:g} to {MAX_DENSITY:g}, not {self.density:g}")


@dataclass(frozen=True, kw_only=True, eq=False)
class SketchModel:
    """A tree of a photograph, ready to be written."""

    srgb: NDArray[np.uint8]  # (h, w, 3) the picture that it was made of
    strokes: TreeStrokes  # in its pixels
    tree: SketchedTree  # likewise
    asset_from_photo: Floats  # (4, 4) as that of the tree, from the pixels of the photograph
    branches: PlantBranches
    leaves: GrownLeaves | None
    foliage: BranchLeaves | None
    crown: CrownModel | None
    remarks: tuple[Remark, ...]


def apply_choices(settings: SketchModelSettings, choices: SketchChoices) -> SketchModelSettings:
    """The settings with what was chosen for a drawing.

    Raises:
        ValueError: A value is out of its range.
    """
    tree, growth = settings.tree, settings.tree.growth
    if choices.gravity is not None:
        growth = replace(growth, gravity=float(choices.gravity))
    return replace(
        settings,
        tree=replace(
            tree,
            height_m=tree.height_m if choices.height_m is None else float(choices.height_m),
            depth=tree.depth if choices.depth is None else float(choices.depth),
            seed=tree.seed if choices.seed is None else choices.seed,
            growth=growth,
        ),
        density=settings.density if choices.density is None else float(choices.density),
        leaf_length_m=settings.leaf_length_m if choices.leaf_length_m is None else float(choices.leaf_length_m),
    )


def choices_of(settings: SketchModelSettings) -> SketchChoices:
    """What apply_choices would take to come to these settings."""
    return SketchChoices(
        height_m=settings.tree.height_m,
        depth=settings.tree.depth,
        density=settings.density,
        gravity=settings.tree.growth.gravity,
        leaf_length_m=settings.leaf_length_m,
        seed=settings.tree.seed,
    )


def to_display(linear: NDArray[np.float32]) -> NDArray[np.uint8]:
    """(H, W, 3) a linear photograph as sRGB, 0 to 255."""
    return np.asarray(np.rint(255 * encode_srgb(np.clip(linear, 0, 1))), np.uint8)


def work_picture(linear: NDArray[np.float32]) -> tuple[NDArray[np.float32], float]:
    """The picture (h, w, 3) that a tree is made of, and its size in those of the photograph (H, W, 3)."""
    shrunk = min(1.0, WORK_PX / max(linear.shape[:2]))
    if shrunk < 1:
        width, height = (max(1, round(side * shrunk)) for side in linear.shape[1::-1])
        linear = cv2.resize(linear, (width, height), interpolation=cv2.INTER_AREA)
    return linear, shrunk


def scale_strokes(strokes: TreeStrokes, factor: float) -> TreeStrokes:
    """Strokes in the pixels of a picture of another size."""
    return TreeStrokes(
        crown_px=strokes.crown_px * factor, branches_px=tuple(line * factor for line in strokes.branches_px)
    )


def model_tree(
    linear: NDArray[np.float32],
    strokes: TreeStrokes,
    settings: SketchModelSettings,
    seconds: dict[str, float],
    progress: StepProgress | None = None,
    watch: Watch | None = None,
    leaf_pixels: Foliage | None = None,
) -> SketchModel:
    """Make a tree of a photograph.

    Args:
        linear: (H, W, 3), the photograph, linear Rec.709.
        strokes: Over one tree.
        settings: How.
        seconds: What each step took is added.
        progress: Called at each step.
        watch: Called with the axes while the tree grows, as grow_axes does.
        leaf_pixels: As sketch_tree takes it.

    Raises:
        FoliageError: The strokes hold no tree.
    """
    linear, shrunk = work_picture(linear)
    if shrunk < 1:
        strokes = scale_strokes(strokes, shrunk)
        if settings.tree.metres_per_px is not None:
            scaled = replace(settings.tree, metres_per_px=settings.tree.metres_per_px / shrunk)
            settings = replace(settings, tree=scaled)
    srgb = to_display(linear)
    # Who asks for leaves has seen them.
    of_tree = replace(settings.tree, require_foliage=settings.tree.require_foliage and settings.has_leaves is not True)
    with follow_step("tree", seconds, progress) as advance:
        tree = sketch_tree(
            srgb, strokes, settings.species, of_tree, report=advance, watch=watch, leaf_pixels=leaf_pixels
        )
    with follow_step("surface", seconds, progress):
        made = build_surfaces(tree.skeleton, settings.max_faces)
    remarks = list(made.remarks)
    if tree.evidence.is_little:
        text = f"what was taken for leaves has little of foliage ({tree.evidence})"
        remedy = "look at the leaves in the report, and draw the stroke around the tree if they are none"
        remarks.append(remark("foliage-improbable", text, remedy=remedy))
    bark = _bark_color(srgb, strokes, tree)
    branches = PlantBranches(
        skeleton=SkeletonPrim(
            skeleton=made.skeleton,
            growth={
                "rootDiameter": float(2 * made.skeleton.radius_m[0]),
                "internodeLength": settings.species.internode_m,
                "allometryExponent": settings.species.exponent,
            },
        ),
        surfaces=made.surfaces,
        settings=BranchAssetSettings() if bark is None else BranchAssetSettings(color=bark),
    )
    leaves = None
    foliage = None
    has_leaves = not tree.foliage.is_bare if settings.has_leaves is None else settings.has_leaves
    if has_leaves:
        with follow_step("leaves", seconds, progress):
            request = SketchLeaves(
                species=settings.species,
                length_m=settings.leaf_length_m,
                density=settings.density,
                max_leaves=settings.max_leaves,
                representations=settings.representations,
                leaf=settings.leaf,
                seed=settings.tree.seed,
            )
            leaves, foliage = grow_sketch_leaves(tree, branches.skeleton.skeleton, srgb, linear, request)
            remarks += leaves.remarks
    elif settings.has_leaves is None:
        remarks.append(remark("tree-without-leaves", "the photograph shows twigs and no leaves; the tree has none"))
    with follow_step("motion", seconds, progress):
        branches = _with_motion(branches, foliage, settings)
    crown = None
    if settings.has_crown and has_leaves:
        with follow_step("crown", seconds, progress):
            crown, of_crown = _crown(tree, linear, settings)
            remarks += of_crown
    return SketchModel(
        srgb=srgb,
        strokes=strokes,
        tree=tree,
        asset_from_photo=tree.asset_from_photo @ np.diag([shrunk, shrunk, shrunk, 1.0]),
        branches=branches,
        leaves=leaves,
        foliage=foliage,
        crown=crown,
        remarks=tuple(remarks),
    )


def _with_motion(branches: PlantBranches, foliage: BranchLeaves | None, settings: SketchModelSettings) -> PlantBranches:
    """The branches with the rig, the sway and the growth that were asked for."""
    skeleton, surfaces, motion = branches.skeleton.skeleton, branches.surfaces, settings.motion
    leaves = None if foliage is None or not len(foliage.leaves) else foliage.leaves
    rig = rig_branches(skeleton, surfaces, motion, settings.tree.seed)
    growth = None
    if motion.growth_frames:
        species = settings.species
        growth = grow_near_leaves(skeleton, surfaces, motion, species.internode_m, species.exponent, leaves)
    rigged = None
    if rig is not None and leaves is not None:
        rigged = rig_near_leaves(rig, skeleton, leaves, np.unique(surfaces.whole.curve))
    return replace(branches, rig=rig, growth=growth, rigged_leaves=rigged)


def _bark_color(srgb: NDArray[np.uint8], strokes: TreeStrokes, tree: SketchedTree) -> tuple[float, float, float] | None:
    """The median colour of the pixels that show branches, linear; None where too few do."""
    stems = [each.points_px for each in tree.traced.branches if each.parent < 0]
    points = np.concatenate([points_at(stem, np.arange(0.0, arc_lengths(stem)[-1] + 1)) for stem in stems])
    x, y = np.clip(np.floor(points).astype(int), 0, [srgb.shape[1] - 1, srgb.shape[0] - 1]).T
    shows = ~tree.foliage.mask[y, x] | (tree.traced.likely[y, x] > 0)
    below = shows & ~tree.foliage.inside[y, x]  # in the crown sky and shade lie beside what is no leaf
    shows = below if below.sum() >= _FEW_BARK else shows
    if shows.sum() < _FEW_BARK:
        return None
    red, green, blue = decode_srgb(np.median(srgb[y[shows], x[shows]], axis=0) / 255).tolist()
    return red, green, blue


def _crown(
    tree: SketchedTree, linear: NDArray[np.float32], settings: SketchModelSettings
) -> tuple[CrownModel | None, list[Remark]]:
    """The crown of the same photograph, in the tree's frame; None and why where there can be none."""
    inside = tree.bounds.inside
    rows = np.flatnonzero(inside.any(axis=1))
    scale_m = float(np.linalg.norm(tree.asset_from_photo[:3, 0]))
    try:
        model, _ = reconstruct_crown(
            linear,
            inside,
            CrownSettings(size=CROWN_SIZE, height_m=scale_m * float(np.ptp(rows) + 1), seed=settings.tree.seed),
            foliage=tree.foliage.mask,
        )
    except (FitError, ValueError) as error:
        return None, [remark("crown-left-out", f"the tree has no crown for the distance: {error}")]
    own_scale = float(np.linalg.norm(model.asset_from_photo[:3, 0]))
    center_px = np.linalg.inv(model.asset_from_photo) @ np.append(model.center_m, 1.0)
    center_m = (tree.asset_from_photo @ center_px)[:3]
    return (
        replace(
            model,
            radius_m=(model.radius_m * (scale_m / own_scale)).astype(np.float32),
            center_m=center_m,
            asset_from_photo=tree.asset_from_photo,
        ),
        [],
    )
