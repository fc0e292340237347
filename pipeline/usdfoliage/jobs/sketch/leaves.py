"""The leaves of a tree out of one photograph: on twigs, as large as the picture has them, and where it has them."""

from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from usdfoliage.asset.parts.leaf_part import BranchLeaves
from usdfoliage.branch.foliage.species import GENERIC, Species, load_species
from usdfoliage.branch.model import Skeleton
from usdfoliage.geometry.directions import unit_vectors, vectors_across
from usdfoliage.jobs.branches.foliage import TEMPLATE, FoliageRequest, GrownLeaves, grow_leaves
from usdfoliage.jobs.leaf_picture import GivenLeaf
from usdfoliage.leaf.change import join_leaves
from usdfoliage.leaf.model import LeafOrigin, Leaves
from usdfoliage.leaf.shape.edits import slim_leaves
from usdfoliage.leaf.shape.jitter import spread_phases
from usdfoliage.leaf.shape.measures import leaf_width
from usdfoliage.leaf.shape.surface import evaluate_points
from usdfoliage.sketch.bounds import view_from_the_side
from usdfoliage.sketch.drawing import SHIFT, fixed_points
from usdfoliage.sketch.growth import crown_size
from usdfoliage.sketch.leaf_choice import fit_leaves
from usdfoliage.sketch.leaf_fill import LeafFillSettings, fill_gaps
from usdfoliage.sketch.leaf_scale import measure_leaf_length
from usdfoliage.sketch.reconstruct import SketchedTree

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

OF_ROOT = 0.25  # of the root's radius, below which twigs of a young tree carry leaves
_LAYERS = 4.0  # of leaves, that cover a crown from its front to its back
_STEP_PX = 2.0  # between places of a twig that a leaf may stand on
_LIGHT = np.array([0.0, 0.6, 0.8])  # where blades over gaps turn to: up, and to the viewer who sees them
_SHORTEST_INTERNODE_M = 1e-4  # that a species may have
_SCATTER = 0.3  # standard deviation, of that direction
_SLIMMEST, _WIDEST = 0.02, 1.5  # in its lengths, that a leaf of a species may be
_OUTLINE_V = (0.0, 0.15, 0.35, 0.55, 0.75, 0.9, 1.0)


@dataclass(frozen=True, kw_only=True)
class SketchLeaves:
    """Which leaves were asked for."""

    species: Species = field(default_factory=lambda: load_species(GENERIC))
    length_m: float | None = None  # None: by the texture of the photograph
    density: float = 1.0  # times as many as the species has and the photograph shows
    max_leaves: int = 20_000
    representations: tuple[str, ...] | None = None  # None: by their number
    leaf: GivenLeaf | None = None  # whose form and look they have; None: that of the species
    seed: int = 0


def grow_sketch_leaves(
    tree: SketchedTree,
    skeleton: Skeleton,
    srgb: NDArray[np.uint8],
    linear: NDArray[np.float32],
    request: SketchLeaves,
) -> tuple[GrownLeaves, BranchLeaves]:
    """Leaves on the twigs, and those of them that fit the photograph with those that fill its gaps.

    Args:
        tree: Of the photograph.
        skeleton: Its branches, as they are written.
        srgb: (H, W, 3), the photograph.
        linear: (H, W, 3), likewise, linear Rec.709.
        request: Which leaves.
    """
    given = request.leaf
    species = request.species if given is None else replace(request.species, leaf_width=_width_of(given))
    cover = 1.0 if given is None else given.cover
    length_m = request.length_m or _length_by_texture(tree, srgb, species, cover * request.max_leaves)
    species = scale_species(species, length_m)
    if request.density > 1:
        species = replace(species, internode_m=max(species.internode_m / request.density, _SHORTEST_INTERNODE_M))
    asked = FoliageRequest(
        kind=TEMPLATE,
        species=species,
        form=None if given is None else given.parameters,
        representations=request.representations,
    )
    asked = replace(asked, settings=replace(asked.settings, max_leaves=request.max_leaves, of_root=OF_ROOT))
    grown = grow_leaves(skeleton, asked, None, request.seed)
    assert grown is not None
    rng = np.random.default_rng([request.seed, 1])
    leaves = _choose_leaves(grown.foliage.leaves, tree, linear, rng)
    for view_of in (_front_view, _side_view):
        view = view_of(tree, leaves, cover)
        filled = _fill_leaves(leaves, grown.foliage.leaves, skeleton, species, view, request.max_leaves, rng)
        if len(filled):
            leaves = join_leaves([leaves, _choose_leaves(filled, tree, linear, rng)])
    leaves = replace(leaves, phase=spread_phases(len(leaves)))
    if request.density < 1:  # of nodes that are farther apart every short shoot would keep one
        drawn = np.random.default_rng([request.seed, 2]).random(len(leaves))
        leaves = leaves.take(np.flatnonzero(drawn < request.density))
    foliage = replace(grown.foliage, leaves=leaves)
    return grown, foliage if given is None else replace(foliage, appearance=given.appearance, edits=given.edits)


def scale_species(species: Species, length_m: float) -> Species:
    """A species with leaves of another length, that stand as close in their own measure."""
    factor = length_m / species.leaf_length_m
    return replace(
        species,
        leaf_length_m=length_m,
        internode_m=species.internode_m * factor,
        shoot_m=species.shoot_m * max(factor, 1.0),
    )


def _width_of(leaf: GivenLeaf) -> float:
    """Of a leaf, in its lengths, as a species may have it."""
    return float(np.clip(leaf_width(leaf.parameters[None])[0], _SLIMMEST, _WIDEST))


def _length_by_texture(tree: SketchedTree, srgb: NDArray[np.uint8], species: Species, max_leaves: float) -> float:
    """Metres, by the texture of the photograph; that of the species where it shows too little."""
    size_px = crown_size(tree.bounds)
    length_px = measure_leaf_length(srgb, tree.foliage.mask, size_px)
    if length_px is None:
        return species.leaf_length_m
    area_px = float(tree.foliage.mask.sum())
    # So many leaves cannot cover it if they are smaller.
    covering_px = np.sqrt(_LAYERS * area_px / (0.6 * species.leaf_width * max_leaves))
    return max(length_px, float(covering_px)) * float(np.linalg.norm(tree.asset_from_photo[:3, 0]))


def _choose_leaves(leaves: Leaves, tree: SketchedTree, linear: NDArray[np.float32], rng: np.random.Generator) -> Leaves:
    """Those of the leaves that are over leaves of the picture, in its colours."""
    to_picture = _picture_from_asset(tree)
    fitting = fit_leaves(
        leaves.base_m @ to_picture[:3, :3].T + to_picture[:3, 3],
        _directions(leaves),
        leaves.length_m * float(np.linalg.norm(to_picture[:3, 0])),
        tree.bounds,
        linear,
        tree.foliage.mask,
        tree.foliage.pure,
        rng,
    )
    origin = np.where(fitting.seen, LeafOrigin.COMPLETED, LeafOrigin.OF_SPECIES).astype(np.int32)
    return replace(leaves, color=fitting.color, origin=origin).take(np.flatnonzero(fitting.kept))


@dataclass(frozen=True, kw_only=True, eq=False)
class _View:
    """From where leaves are seen, and what they are to cover there."""

    from_asset: Floats  # (4, 4)
    mask: Mask  # (H, W), where leaves are to be seen
    allowed: Mask  # (H, W), that with its narrow gaps
    enough: float = LeafFillSettings().enough  # share that may stay open
    cover: float = 1.0  # share of a leaf within its silhouette, that its texture shows


def _front_view(tree: SketchedTree, _leaves: Leaves, cover: float) -> _View:
    """The photograph's own."""
    return _View(from_asset=_picture_from_asset(tree), mask=tree.foliage.mask, allowed=tree.bounds.leaves, cover=cover)


def _side_view(tree: SketchedTree, leaves: Leaves, cover: float) -> _View:
    """From the side, where the crown is as dense as from the front, whose gaps the photograph shows."""
    inside = tree.bounds.inside
    covered = (_covered(leaves, _front_view(tree, leaves, cover)) & inside).sum() / max(inside.sum(), 1)
    side = view_from_the_side(tree.bounds)
    return _View(
        from_asset=side.from_picture @ _picture_from_asset(tree),
        mask=side.inside,
        allowed=side.inside,
        enough=float(1 - covered),
        cover=cover,
    )


def _fill_leaves(
    leaves: Leaves,
    every: Leaves,
    skeleton: Skeleton,
    species: Species,
    view: _View,
    max_leaves: int,
    rng: np.random.Generator,
) -> Leaves:
    """Leaves over the gaps that the chosen ones leave in a view, each of the form of one of all."""
    if not len(every):
        return every
    scale = float(np.linalg.norm(view.from_asset[:3, 0]))
    filled = fill_gaps(
        _covered(leaves, view),
        view.mask,
        view.allowed,
        _places_on_twigs(skeleton, species, view.from_asset),
        species.leaf_length_m * scale,
        species.leaf_width * view.cover,
        max_leaves - len(leaves),
        rng,
        LeafFillSettings(enough=view.enough),
    )
    count = len(filled.base)
    if not count:
        return every.take(np.zeros(0, int))
    like = every.take(rng.integers(len(every), size=count))
    to_asset = np.linalg.inv(view.from_asset)
    turn = to_asset[:3, :3] * scale
    y = filled.along @ turn.T
    x = vectors_across(y, unit_vectors((_LIGHT + rng.normal(0, _SCATTER, (count, 3))) @ turn.T))
    return replace(
        like,
        base_m=filled.base @ to_asset[:3, :3].T + to_asset[:3, 3],
        orientation=Rotation.from_matrix(np.stack([x, y, np.cross(x, y)], axis=-1)).as_quat(canonical=True),
        length_m=np.full(count, species.leaf_length_m),
    )


def _places_on_twigs(skeleton: Skeleton, species: Species, to_view: Floats) -> Floats:
    """(N, 3) places on the twigs that carry leaves, in the frame of a view."""
    thin_m = max(species.twig_radius_m, OF_ROOT * float(skeleton.radius_m[0]))
    points = skeleton.points_m @ to_view[:3, :3].T + to_view[:3, 3]
    same = skeleton.curve[1:] == skeleton.curve[:-1]
    thin = np.maximum(skeleton.radius_m[1:], skeleton.radius_m[:-1]) <= thin_m
    one = np.flatnonzero(same & thin)
    if not len(one):
        return np.zeros((0, 3))
    step = points[one + 1] - points[one]
    count = np.maximum(1, np.ceil(np.linalg.norm(step, axis=1) / _STEP_PX).astype(int))
    segment = np.repeat(np.arange(len(one)), count)
    share = (np.arange(len(segment)) - np.repeat(np.cumsum(count) - count, count) + 1) / count[segment]
    return np.asarray(points[one][segment] + share[:, None] * step[segment])


def _covered(leaves: Leaves, view: _View) -> Mask:
    """(H, W) what leaves cover in a view, by their outlines."""
    drawn = np.zeros(view.mask.shape, np.uint8)
    if not len(leaves):
        return drawn > 0
    if view.cover < 1:  # as much narrower as its texture leaves out of it
        slim = slim_leaves(leaves.parameters, np.full(len(leaves), view.cover))
        leaves = replace(leaves, parameters=slim)
    around = [(1.0, v) for v in _OUTLINE_V] + [(-1.0, v) for v in _OUTLINE_V[-2:0:-1]]
    points = evaluate_points(leaves.parameters, np.array(around), placements=leaves.asset_from_leaf())
    flat = (points @ view.from_asset[:3, :3].T + view.from_asset[:3, 3])[..., :2] * [1, -1]
    for corners in fixed_points(flat):
        cv2.fillPoly(drawn, [corners], 1, shift=SHIFT)
    return drawn > 0


def _directions(leaves: Leaves) -> Floats:
    """(N, 3), unit, from base to apex."""
    x, y, z, w = leaves.orientation.T
    return unit_vectors(np.stack([2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)], axis=-1))


def _picture_from_asset(tree: SketchedTree) -> Floats:
    """(4, 4) from metres of the asset to the frame of the picture, which has y up."""
    return np.asarray(np.diag([1.0, -1.0, 1.0, 1.0]) @ np.linalg.inv(tree.asset_from_photo))
