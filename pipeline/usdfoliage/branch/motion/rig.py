"""A rig of branches: joints that turn them, and how much each place of a surface follows which joint.

A joint stands where a branch springs, its y axis along the branch; joints hang together as their branches do. Branches
beyond an order have none and follow the place that they spring from. Where a branch leaves its parent it goes over from
the parent's joint to its own, so that nothing tears. The arrangement is our own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.axis_places import Exits, axis_exits
from usdfoliage.branch.cage.tubes import rotate_between
from usdfoliage.branch.model import Skeleton

_GRAIN = 512  # weights are multiples of one part of so many: exact in binary, and few enough to be packed well


@dataclass(frozen=True, kw_only=True)
class RigSettings:
    """Which branches have joints, and how softly they bend."""

    order: int = 2  # of the last ones that have a joint
    blend_radii: float = 4.0  # of the parent, over which a branch goes over to its own joint, at least
    blend_share: float = 0.15  # of the branch's length, at least
    max_share: float = 0.6  # of what is out of the parent, at most

    def __post_init__(self) -> None:
        if self.order < 0:
            raise ValueError(f"order must be 0 or more, not {self.order}")
        if not (self.blend_radii >= 0 and 0 <= self.blend_share <= 1 and 0 < self.max_share <= 1):
            raise ValueError(
                "blend_radii must be 0 or more, blend_share 0 to 1, max_share above 0 and at most 1, not "
                f"{self.blend_radii:g}, {self.blend_share:g}, {self.max_share:g}"
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class Rig:
    """J joints; a joint comes after its parent. Metres, in the skeleton's frame."""

    curve: NDArray[np.int32]  # (J,), branch that the joint turns
    parent: NDArray[np.int32]  # (J,), joint, -1 for that of a root
    origin_m: NDArray[np.float64]  # (J, 3), where the branch springs
    axes: NDArray[np.float64]  # (J, 3, 3), columns are the joint's x, y, z; y along the branch
    has_joint: NDArray[np.bool_]  # (B,)
    chain: NDArray[np.int32]  # (B, K), joints from the root's to that which the branch follows last, then 0
    sprung: NDArray[np.float64]  # (B, K), how much the place that the branch comes out of follows each of them
    own: NDArray[np.int64]  # (B,), column of its own joint
    leaves_m: NDArray[np.float64]  # (B,), along the branch, up to where it follows its parent alone; -inf for a root
    blend_m: NDArray[np.float64]  # (B,), from there until it follows its own joint alone

    def __len__(self) -> int:
        return len(self.curve)

    @property
    def bind(self) -> NDArray[np.float64]:
        """(J, 4, 4) asset from joint, for column vectors."""
        bind = np.tile(np.eye(4), (len(self), 1, 1))
        bind[:, :3, :3] = self.axes
        bind[:, :3, 3] = self.origin_m
        return bind

    @property
    def rest(self) -> NDArray[np.float64]:
        """(J, 4, 4) parent joint, or asset, from joint, for column vectors."""
        bind = self.bind
        child = self.parent >= 0
        rest = bind.copy()
        rest[child] = np.linalg.inv(bind[self.parent[child]]) @ bind[child]
        return rest


@dataclass(frozen=True, kw_only=True, eq=False)
class Skin:
    """How places follow joints."""

    joints: NDArray[np.int32]  # (P, K)
    weights: NDArray[np.float64]  # (P, K), 0 to 1, the largest first, 1 together


def build_rig(
    skeleton: Skeleton,
    settings: RigSettings = RigSettings(),
    exits: Exits | None = None,
    drawn: NDArray[np.bool_] | None = None,
) -> Rig:
    """Give branches up to an order a joint each.

    Args:
        skeleton: Of all branches.
        settings: Up to which order, and how softly.
        exits: Where branches come out of those that carry them; where their axes do by default.
        drawn: (B,), those that anything is drawn of: others have no joint, but for roots.
    """
    count = len(skeleton)
    exits = axis_exits(skeleton) if exits is None else exits
    root = skeleton.parent_curve < 0
    wanted = skeleton.order <= settings.order
    if drawn is not None:
        wanted &= drawn | root
    turned = np.flatnonzero(wanted)
    joint = np.full(count, -1, np.int32)
    joint[turned] = np.arange(len(turned), dtype=np.int32)
    # The last joint that a branch follows is its own, or that of what it springs from.
    below, last = np.full(count, -1, np.int32), joint.copy()
    for number in np.flatnonzero(~root).tolist():  # parents first
        below[number] = last[exits.curve[number]]
        last[number] = joint[number] if wanted[number] else below[number]

    length_m = skeleton.lengths_m
    parent_m = np.where(root, 0.0, skeleton.radius_m[skeleton.parent_vertex])
    blend_m = np.maximum(settings.blend_radii * parent_m, settings.blend_share * length_m)
    # What is hardly out of its parent turns little: better than a step.
    min_m = np.minimum(blend_m, np.maximum(parent_m, 1e-9))
    blend_m = np.maximum(np.minimum(blend_m, settings.max_share * (length_m - exits.arc_m)), min_m)
    columns = int(skeleton.order[wanted].max(initial=0)) + 1
    rig = Rig(
        curve=turned.astype(np.int32),
        parent=below[turned],
        origin_m=skeleton.points_m[skeleton.first[turned]],
        axes=_axes(skeleton, turned),
        has_joint=wanted,
        chain=np.zeros((count, columns), np.int32),
        sprung=np.zeros((count, columns)),
        own=np.minimum(skeleton.order, columns - 1).astype(np.int64),
        leaves_m=np.where(root, -np.inf, exits.arc_m),
        blend_m=blend_m,
    )
    for order in range(int(skeleton.order.max(initial=-1)) + 1):
        mine = np.flatnonzero(skeleton.order == order)
        child = mine[~root[mine]]
        rig.chain[child] = rig.chain[exits.curve[child]]
        rig.sprung[child] = _follow(rig, exits.curve[child], exits.parent_arc_m[child])
        mine = mine[wanted[mine]]
        rig.chain[mine, rig.own[mine]] = joint[mine]
    return rig


def skin_places(rig: Rig, curve: NDArray[np.integer], arc_m: NDArray[np.float64]) -> Skin:
    """How places (P,) at lengths along branches (P,) follow the joints: points of a surface, or leaves."""
    weights = np.round(_GRAIN * _follow(rig, curve, arc_m)) / _GRAIN
    largest = weights.argmax(axis=1)
    row = np.arange(len(weights))
    weights[row, largest] += 1 - weights.sum(axis=1)
    joints = np.where(weights > 0, rig.chain[curve], 0)
    by_weight = np.argsort(-weights, axis=1, kind="stable")
    joints, weights = np.take_along_axis(joints, by_weight, 1), np.take_along_axis(weights, by_weight, 1)
    used = max(1, int((weights > 0).any(axis=0).sum()))
    return Skin(joints=np.ascontiguousarray(joints[:, :used]), weights=np.ascontiguousarray(weights[:, :used]))


def _follow(rig: Rig, curve: NDArray[np.integer], arc_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(P, K) weights of the joints in the chains of branches, at places on them."""
    share = np.clip((arc_m - rig.leaves_m[curve]) / rig.blend_m[curve], 0, 1)
    share = share * share * (3 - 2 * share)
    share = np.where(rig.has_joint[curve], share, 0.0)
    weights = (1 - share[:, None]) * rig.sprung[curve]
    weights[np.arange(len(curve)), rig.own[curve]] += share
    return np.asarray(weights)


def _axes(skeleton: Skeleton, curves: NDArray[np.integer]) -> NDArray[np.float64]:
    """(J, 3, 3) frames whose y axis points from a branch's first point to its tip, turned least from the asset's."""
    start_m = skeleton.points_m[skeleton.first[curves]]
    along_m = skeleton.points_m[skeleton.first[curves] + skeleton.counts[curves] - 1] - start_m
    length_m = np.linalg.norm(along_m, axis=1, keepdims=True)
    up = np.broadcast_to([0.0, 1.0, 0.0], along_m.shape)
    y = np.where(length_m > 0, along_m / np.where(length_m > 0, length_m, 1), up)
    x = rotate_between(up, y, np.broadcast_to([1.0, 0.0, 0.0], along_m.shape))
    x = x - np.sum(x * y, axis=1, keepdims=True) * y
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=-1)
