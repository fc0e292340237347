"""A natural leaf, and leaves that differ from it as those of one plant do."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.leaf.shape.fold import find_folds
from usdfoliage.leaf.shape.measures import leaf_width
from usdfoliage.leaf.shape.surface import leaf_nets

LIMIT = 2.5  # standard deviations; what is drawn beyond is taken in to it, so that no leaf is a monster
MAX_SHIFT = 0.24  # below 1/4 the shift of v along the axis keeps every order
STEPS_BACK = 6  # halvings of what a leaf differs from the mean, before it becomes the mean
BLOCK = 1 << 15  # leaves checked together, so that a million need little memory besides their own
ON_INNER, ON_OUTER = 1 / 3, 2 / 3  # of what lifts the silhouette of a half that stays straight across


@dataclass(frozen=True, kw_only=True)
class VariationSettings:
    """How much leaves differ: standard deviations, in leaf lengths where no other unit is named.

    Attributes:
        amount: A factor on all that follow: 0 makes all leaves the same, 1 is as on a plant.
        width: Of the logarithm of the width.
        outline: Of the widest place, along the axis.
        fullness: Of the logarithm of the width near the base and near the apex.
        asymmetry: Of the axis, sideways.
        arch: Of the axis, upwards.
        fold: Of the height of the halves, as a share of their width.
        roll: Of the height of the silhouettes alone, as a share of the width.

    Raises:
        ValueError: A number is below 0 or not finite.
    """

    amount: float = 1.0
    width: float = 0.11
    outline: float = 0.025
    fullness: float = 0.15
    asymmetry: float = 0.035
    arch: float = 0.05
    fold: float = 0.25
    roll: float = 0.07

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            number = getattr(self, name)
            if not (np.isfinite(number) and number >= 0):
                raise ValueError(f"{name} must be 0 or more, not {number}")


def default_leaf() -> NDArray[np.float64]:
    """A leaf (7, 3) as of a beech or a cherry: half as wide as long, a flat V, arched, with a drawn-out tip."""
    return np.array(
        [
            [0.0, 0.33, 0.07],
            [0.0, 0.68, 0.085],
            [0.06, 0.17, 0.042],
            [0.43, 0.485, 0.122],
            [0.81, 0.065, 0.014],
            [0.018, 0.054, 0.006],
            [0.034, 0.100, 0.011],
        ]
    )


def leaf_of_width(width: float) -> NDArray[np.float64]:
    """The leaf (7, 3) of default_leaf, so wide, in leaf lengths; its halves keep their slope.

    Raises:
        ValueError: The width is not above 0.
    """
    if not (np.isfinite(width) and width > 0):
        raise ValueError(f"a leaf's width must be above 0, not {width}")
    leaf = default_leaf()
    factor = width / float(leaf_width(leaf[None])[0])
    leaf[2:5, 1:] *= factor
    leaf[5:] *= factor
    return leaf


def vary_leaves(
    count: int,
    rng: np.random.Generator,
    settings: VariationSettings = VariationSettings(),
    mean: NDArray[np.floating] | None = None,
) -> NDArray[np.float64]:
    """Leaves (count, 7, 3) around a mean leaf (7, 3), that of default_leaf without one.

    What a leaf does as a whole varies, not number by number: a narrow leaf has its halves closer together, one that
    arches more also folds them up more. The silhouette points keep their order and their side. A leaf that would fold
    over itself is taken back towards the mean until it does not, unless the mean does.

    Raises:
        ValueError: count is below 0, or the mean is not (7, 3) finite numbers.
    """
    leaf = default_leaf() if mean is None else np.asarray(mean, np.float64)
    if count < 0:
        raise ValueError(f"the number of leaves must be 0 or more, not {count}")
    if leaf.shape != (7, 3) or not np.isfinite(leaf).all():
        raise ValueError(f"the mean leaf must be (7, 3) finite numbers, not {leaf.shape}")
    draw = np.clip(rng.standard_normal((11, count)), -LIMIT, LIMIT) * settings.amount
    width, shift, full_base, full_apex, bend, sway, age, arch, wave, fold, roll = draw
    leaves = np.empty((count, 7, 3))
    leaves[:] = leaf
    _bend_axes(leaves, settings, bend, sway, 0.7 * age + 0.7 * arch, wave)
    _shape_outlines(leaves, settings, width, shift, full_base, full_apex)
    _lift_halves(leaves, settings, 0.6 * age + 0.7 * fold - 0.4 * width, roll)
    unusual = mean is not None or _is_unusual(settings)
    for begin in range(0, count, BLOCK):
        _take_back_folded(leaves[begin : begin + BLOCK], leaf, unusual)
    return leaves


def vary_colors(
    color: tuple[float, float, float] | NDArray[np.float64], count: int, rng: np.random.Generator, amount: float = 1.0
) -> NDArray[np.float64]:
    """Colours (count, 3) of leaves around one, or around (count, 3) of their own, linear Rec.709.

    They are light and dark, and the young ones yellower; none is below 0.
    """
    light, age = np.clip(rng.standard_normal((2, count)), -LIMIT, LIMIT) * amount
    # In octaves: a young leaf is lighter, and more so in red than in green.
    octaves = 0.2 * light[:, None] + age[:, None] * np.array([0.22, 0.12, 0.02])
    return np.asarray(np.minimum(np.array(color) * 2**octaves, 1.0))


def _bend_axes(
    leaves: NDArray[np.float64],
    settings: VariationSettings,
    bend: NDArray[np.float64],
    sway: NDArray[np.float64],
    arch: NDArray[np.float64],
    wave: NDArray[np.float64],
) -> None:
    """Bend axes to a side or sway them to both; one that also waves upwards is a screw and twists the leaf a little."""
    leaves[:, 0, 0] += settings.asymmetry * (0.9 * bend + 0.5 * sway)
    leaves[:, 1, 0] += settings.asymmetry * (0.9 * bend - 0.5 * sway)
    leaves[:, 0, 2] += settings.arch * (0.8 * arch + 0.5 * wave)
    leaves[:, 1, 2] += settings.arch * (arch - 0.5 * wave)


def _shape_outlines(
    leaves: NDArray[np.float64],
    settings: VariationSettings,
    width: NDArray[np.float64],
    shift: NDArray[np.float64],
    full_base: NDArray[np.float64],
    full_apex: NDArray[np.float64],
) -> None:
    v = np.clip(leaves[:, 2:5, 0], 0, 1)
    leaves[:, 2:5, 0] += np.clip(settings.outline * shift, -MAX_SHIFT, MAX_SHIFT)[:, None] * 4 * v * (1 - v)
    lateral = settings.width * width
    leaves[:, 2, 1] *= np.exp(lateral + settings.fullness * full_base)
    leaves[:, 3, 1] *= np.exp(lateral)
    leaves[:, 4, 1] *= np.exp(lateral + settings.fullness * full_apex)


def _lift_halves(
    leaves: NDArray[np.float64], settings: VariationSettings, fold: NDArray[np.float64], roll: NDArray[np.float64]
) -> None:
    """Fold the halves up as a whole, in proportion to their width, and roll their silhouettes up or down."""
    height = settings.fold * fold[:, None] * leaves[:, 2:5, 1]
    rolled = settings.roll * roll[:, None] * leaves[:, 2:5, 1]
    leaves[:, 5] += ON_INNER * height
    leaves[:, 6] += ON_OUTER * height + rolled / 4
    leaves[:, 2:5, 2] += height + rolled


def _is_unusual(settings: VariationSettings) -> bool:
    """Whether leaves may fold elsewhere than at base and apex: not with the default settings, as the tests show."""
    defaults = VariationSettings()
    scales = [name for name in defaults.__dataclass_fields__ if name != "amount"]
    return any(settings.amount * getattr(settings, name) > getattr(defaults, name) for name in scales)


def _take_back_folded(leaves: NDArray[np.float64], mean: NDArray[np.float64], anywhere: bool) -> None:
    """Bring leaves that fold, at base and apex or anywhere, nearer to the mean, in place; not where the mean does."""
    checks: list[Callable[[NDArray[np.float64]], NDArray[np.bool_]]] = [_cross_at_ends]
    if anywhere:
        checks.append(find_folds)
    for check in checks:
        if check(mean[None])[0]:
            continue
        folded = np.flatnonzero(check(leaves))
        for _ in range(STEPS_BACK):
            leaves[folded] = (leaves[folded] + mean) / 2
            folded = folded[check(leaves[folded])]
        leaves[folded] = mean


def _cross_at_ends(leaves: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether the curves of a leaf leave its base or reach its apex in another order than left to right: (N,)."""
    net = leaf_nets(leaves)[..., :2]
    from_base, from_apex = net[:, 1] - net[:, 0], net[:, 3] - net[:, 4]
    return ~np.all(np.concatenate([_turns(from_base) < 0, _turns(from_apex) > 0], axis=1), axis=1)


def _turns(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Above 0 where the next of the directions (N, K, 2) lies to the left: (N, K - 1)."""
    first, second = directions[:, :-1], directions[:, 1:]
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
