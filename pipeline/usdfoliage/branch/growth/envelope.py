"""Envelopes of trees of one kind and age: smooth maps of the space of one tree into that of another.

J. Guo et al., Realistic procedural plant modeling from multiple view images, 2020, section 6.2, has variations within
one envelope. That each has its own is ours: height and width of the crown, its outline, the lean and the bends of the
stem are drawn as they spread in a stand.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.growth.limbs import join_forks
from usdfoliage.branch.model import Skeleton

_LIMIT = 2.0  # standard deviations, beyond which nothing is drawn
_OF_LIMITED = 0.87962566  # standard deviation of what is drawn, of that of the normal distribution it is drawn from
_WITH_HEIGHT = 0.4  # correlation of the width of the crown with the height
_SIDES, _HEIGHTS = 3, 3  # waves of the outline around the crown, and up it
_BENDS = 2  # waves of the stem
_FOOT = 0.12  # of the height, up to which a stem becomes as wide as its crown
_LAYERS = 24  # of the height, in which the middle of the crown is taken
_SMOOTH = 0.12  # of the height, over which it is smoothed
_STEEPEST = 0.7  # of what is moved up or down, so that nothing is folded


@dataclass(frozen=True, kw_only=True)
class EnvelopeSettings:
    """How much trees of a stand differ; standard deviations."""

    height: float = 0.1  # of the mean height
    crown: float = 0.12  # of the mean radius
    outline: float = 0.12  # of the radius, around the crown and up it
    rise: float = 0.06  # of the height, by which what is in the middle stands higher or lower
    twist_deg: float = 20.0  # from the foot to the top
    lean_deg: float = 2.5  # of the whole stem, to any side
    bend: float = 0.02  # of the height, by which a stem is beside its straight line

    def __post_init__(self) -> None:
        amounts = (self.height, self.crown, self.outline, self.rise, self.twist_deg, self.lean_deg, self.bend)
        if not all(np.isfinite(amount) and amount >= 0 for amount in amounts):
            raise ValueError("what differs must not be below 0")
        if not (self.height <= 0.5 and self.crown <= 0.5 and self.outline <= 0.5 and self.lean_deg <= 30):
            raise ValueError("height, crown and outline must be 0.5 or less, lean_deg 30 or less")
        if not (self.rise <= 0.5 and self.bend <= 0.5 and self.twist_deg <= 180):
            raise ValueError("rise and bend must be 0.5 or less, twist_deg 180 or less")


@dataclass(frozen=True, kw_only=True, eq=False)
class Envelope:
    """What one tree has of another; neutral by default."""

    height: float = 1.0  # factor
    crown: float = 1.0  # factor of radii
    turn_rad: float = 0.0  # of all about the vertical
    mirrored: bool = False
    # (2, 4, 3), cosine and sine around, waves around, waves up; of the logarithm of radii.
    outline: NDArray[np.float64] = field(default_factory=lambda: np.zeros((2, _SIDES + 1, _HEIGHTS)))
    rise: float = 0.0  # of the height, in the middle
    twist_rad: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))  # at the top, and in the middle
    lean: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))  # slope towards x and z
    bend: NDArray[np.float64] = field(default_factory=lambda: np.zeros((_BENDS, 2)))  # of the height, towards x and z

    @property
    def size(self) -> float:
        """Factor of lengths, as of a cube of the same volume."""
        return float(np.cbrt(self.height * self.crown**2))


@dataclass(frozen=True, kw_only=True, eq=False)
class TreePlace:
    """Where a tree stands, and the middle of its crown at each height."""

    foot_m: NDArray[np.float64]  # (3,)
    height_m: float
    middle_m: NDArray[np.float64]  # (25, 2), x and z beside the foot, evenly up the height


def draw_envelope(settings: EnvelopeSettings, spread: float, seed: int) -> Envelope:
    """The envelope of another tree of the same stand; neutral where spread is 0.

    Args:
        settings: How much trees differ.
        spread: Times that, 0 or more.
        seed: Of what is drawn.
    """
    rng = np.random.default_rng([seed, 1])
    of_height, of_crown = _limited(rng, 2)
    of_crown = _WITH_HEIGHT * of_height + np.sqrt(1 - _WITH_HEIGHT**2) * of_crown
    around, up = np.meshgrid(np.arange(_SIDES + 1), np.arange(_HEIGHTS), indexing="ij")
    wave = 1 / (1 + around + up)  # the finer, the lower
    wave[0, 0] = 0  # that is the crown's own factor
    # Waves around have a cosine and a sine, each half of a variance; waves up, but the first, have a half on average.
    wave /= np.sqrt((wave**2 * np.where(up == 0, 1.0, 0.5)).sum())
    outline = _limited(rng, (2, _SIDES + 1, _HEIGHTS)) * wave
    outline[1, 0] = 0  # no sine around
    turn, mirror = rng.uniform(-1, 1), rng.random()
    rise, lean, bend, twist = _limited(rng, 1), _limited(rng, 2), _limited(rng, (_BENDS, 2)), _limited(rng, 2)
    return Envelope(
        height=_factor(spread * settings.height, float(of_height)),
        crown=_factor(spread * settings.crown, float(of_crown)),
        turn_rad=np.pi * min(spread, 1.0) * turn,
        mirrored=bool(mirror < 0.5 * min(spread, 1.0)),
        outline=spread * settings.outline * outline,
        rise=float(np.clip(spread * settings.rise * rise[0], -_STEEPEST / np.pi, _STEEPEST / np.pi)),
        twist_rad=spread * np.radians(settings.twist_deg) * twist,
        lean=np.tan(spread * np.radians(settings.lean_deg)) * lean / np.sqrt(2),
        bend=spread * settings.bend * bend / np.arange(1, _BENDS + 1)[:, None],
    )


def measure_tree_place(points_m: NDArray[np.float64], roots_m: NDArray[np.float64]) -> TreePlace:
    """Where a tree stands.

    Args:
        points_m: (N, 3) of the tree, at least one, Y up; metres.
        roots_m: (R, 3) of its stems, at least one; the first is its foot, the origin of its asset.
    """
    foot_m = roots_m[0]
    height_m = max(float(points_m[:, 1].max() - foot_m[1]), 1e-9)
    at = np.linspace(0, 1, _LAYERS + 1)
    share = np.clip((points_m[:, 1] - foot_m[1]) / height_m, 0, 1)
    layer = np.rint(share * _LAYERS).astype(np.int64)
    count = np.bincount(layer, minlength=_LAYERS + 1)
    beside_m = points_m[:, [0, 2]] - foot_m[[0, 2]]
    total = np.column_stack([np.bincount(layer, line, _LAYERS + 1) for line in beside_m.T])
    near = np.exp(-0.5 * ((at[:, None] - at) / _SMOOTH) ** 2)
    middle_m = (near @ total) / np.maximum(near @ count, 1e-9)[:, None]
    return TreePlace(foot_m=foot_m, height_m=height_m, middle_m=_fade(at)[:, None] * middle_m)


def warp_points(points_m: NDArray[np.float64], place: TreePlace, envelope: Envelope) -> NDArray[np.float64]:
    """(N, 3) points of a tree moved into the envelope of another; the foot stays, and what is level with it is level.

    Args:
        points_m: (N, 3), Y up.
        place: Of the tree.
        envelope: Of the other one.
    """
    beside_m, up_m = (points_m - place.foot_m)[:, [0, 2]], points_m[:, 1] - place.foot_m[1]
    share = np.clip(up_m / place.height_m, 0, 1)
    grid = np.linspace(0, 1, len(place.middle_m))
    middle_m = np.column_stack([np.interp(share, grid, line) for line in place.middle_m.T])
    out_m = beside_m - middle_m
    factor = np.exp(_fade(share) * np.log(envelope.crown * np.exp(_outline(out_m, share, envelope))))
    out_m = middle_m * (1 + _fade(share) * (envelope.crown - 1))[:, None] + factor[:, None] * out_m
    if envelope.mirrored:
        out_m = out_m * [1.0, -1.0]
    turn = envelope.turn_rad + envelope.twist_rad[0] * share + envelope.twist_rad[1] * np.sin(np.pi * share)
    cosine, sine = np.cos(turn), np.sin(turn)
    turned_m = np.column_stack([cosine * out_m[:, 0] - sine * out_m[:, 1], sine * out_m[:, 0] + cosine * out_m[:, 1]])
    high_m = envelope.height * place.height_m
    waves = np.arange(1, len(envelope.bend) + 1)
    bends = 0.5 * (1 - np.cos(np.pi * share[:, None] * waves)) @ envelope.bend
    turned_m += high_m * (share[:, None] * envelope.lean + bends)
    raised_m = envelope.height * up_m + high_m * envelope.rise * np.sin(np.pi * share)
    return place.foot_m + np.column_stack([turned_m[:, 0], raised_m, turned_m[:, 1]])


def warp_skeleton(skeleton: Skeleton, place: TreePlace, envelope: Envelope) -> Skeleton:
    """The branches of a tree moved as its points, as thick as the other tree is large."""
    moved_m = warp_points(skeleton.points_m, place, envelope)
    return replace(
        skeleton,
        points_m=join_forks(moved_m, skeleton.counts, skeleton.parent_vertex),
        radius_m=envelope.size * skeleton.radius_m,
    )


def _outline(out_m: NDArray[np.float64], share: NDArray[np.float64], envelope: Envelope) -> NDArray[np.float64]:
    """(N,) logarithm of the factor of radii to these sides (N, 2) and at these heights (N,)."""
    angle = np.arctan2(out_m[:, 1], out_m[:, 0])
    around = np.arange(envelope.outline.shape[1])
    up = np.cos(np.pi * share[:, None] * np.arange(envelope.outline.shape[2]))
    cosines, sines = np.cos(angle[:, None] * around), np.sin(angle[:, None] * around)
    return np.asarray(
        np.einsum("na,ah,nh->n", cosines, envelope.outline[0], up)
        + np.einsum("na,ah,nh->n", sines, envelope.outline[1], up)
    )


def _fade(share: NDArray[np.float64]) -> NDArray[np.float64]:
    """0 at the foot, 1 above the foot of the stem, smooth."""
    part = np.clip(share / _FOOT, 0, 1)
    return np.asarray(part * part * (3 - 2 * part))


def _limited(rng: np.random.Generator, size: int | tuple[int, ...]) -> NDArray[np.float64]:
    """Normally distributed about 0 with variance 1, none far away."""
    drawn = rng.normal(size=size)
    while (far := np.abs(drawn) > _LIMIT).any():
        drawn[far] = rng.normal(size=int(far.sum()))
    return drawn / _OF_LIMITED


def _factor(deviation: float, drawn: float) -> float:
    """Above 0, of mean 1 and such a coefficient of variation."""
    return float(np.exp(deviation * drawn - 0.5 * deviation**2))
