"""When each place on branches that are known is reached, as they grow.

J. Guo et al., Realistic procedural plant modeling from multiple view images, 2020, figure 12: the longest way from the
root follows the logistic growth of equation 6, lengths in internodes. By that law alone a twig of a few internodes is
there at once, since the front passes it in less than a frame. So every branch takes some time, however short it is, and
all of them are there before the end, so that what comes last can thicken and unfold. That is ours.

Times are shares of all the time that the growth takes, 0 to 1.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.allometry import AllometrySettings
from usdfoliage.branch.growth.logistic import LogisticSettings, longest_path
from usdfoliage.branch.model import Skeleton

_GROWN = 0.95  # of the greatest length, that the logistic growth, which has no end, has when it is stopped
_HALVINGS = 40  # of the pace that is looked for
_SLOWEST = 0.8  # of the time, that the front takes: for it, short branches one upon another have less of their own

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class GrowthStageSettings:
    """How branches grow to what they are."""

    initial_internodes: float = 2.0  # H_0
    branch_share: float = 0.08  # of the time, that a branch takes or more from its base to its tip
    thicken_share: float = 0.1  # that a place takes until it is as thick as what it carries asks for
    finish_share: float = 0.15  # at the end, when no branch grows longer
    allometry: AllometrySettings = field(default_factory=AllometrySettings)

    def __post_init__(self) -> None:
        if not 0 < self.initial_internodes < np.inf:
            raise ValueError(f"initial_internodes must be above 0, not {self.initial_internodes:g}")
        for name in ("branch_share", "thicken_share", "finish_share"):
            if not 0 < getattr(self, name) < 1:
                raise ValueError(f"{name} must be above 0 and below 1, not {getattr(self, name):g}")
        if self.thicken_share > self.finish_share:
            raise ValueError(f"thicken_share must be at most finish_share, {self.finish_share:g}")


@dataclass(frozen=True, kw_only=True)
class LogisticFront:
    """Equation 6, from H_0 to the longest way; its own time runs from 0 to 1.

    The share that is missing when it stops is spread over all times, so that growth ends where it is to.
    """

    longest_m: float
    start_m: float  # H_0

    def __post_init__(self) -> None:
        if not 0 < self.start_m < self.longest_m:
            raise ValueError(f"start_m must be above 0 and below {self.longest_m:g}, not {self.start_m:g}")

    @cached_property
    def cycles(self) -> float:
        """rho_0 t at the end."""
        return float(np.log((self.longest_m / self.start_m - 1) * _GROWN / (1 - _GROWN)))

    @property
    def _spread(self) -> float:
        return (self.longest_m - self.start_m) / (_GROWN * self.longest_m - self.start_m)

    def length(self, time: float | Array) -> Array:
        """The longest way at these times, in metres."""
        law = LogisticSettings(
            longest=self.longest_m, initial_share=self.start_m / self.longest_m, initial_units=self.cycles
        )
        grown_m = longest_path(np.clip(time, 0, 1), law)
        return np.asarray(self.start_m + (grown_m - self.start_m) * self._spread)

    def when(self, length_m: Array) -> Array:
        """The time at which the longest way is so long; 0 for what is there from the beginning."""
        grown_m = self.start_m + (np.clip(length_m, self.start_m, self.longest_m) - self.start_m) / self._spread
        ahead = (self.longest_m / grown_m - 1) / (self.longest_m / self.start_m - 1)
        return np.asarray(-np.log(ahead) / self.cycles)


@dataclass(frozen=True, kw_only=True, eq=False)
class GrowthTimes:
    """When B branches begin, and how fast they grow."""

    front: LogisticFront
    path_m: Array  # (V,), from the root to each point of the skeleton
    base_m: Array  # (B,), the same where a branch begins
    begins: Array  # (B,)
    pace: Array  # (B,), time that a branch takes over that which the front takes

    def reach(self, time: float) -> Array:
        """(B,) way from the root to the tip of each branch, if it went on for ever; its base before it begins."""
        own = self.front.when(self.base_m) + (time - self.begins) / self.pace
        return np.asarray(np.where(time < self.begins, self.base_m, np.maximum(self.front.length(own), self.base_m)))

    def born(self, curve: NDArray[np.integer], path_m: Array) -> Array:
        """(P,) time at which places on these branches, this way from the root, are reached."""
        since = self.front.when(path_m) - self.front.when(self.base_m)[curve]
        return np.asarray(self.begins[curve] + self.pace[curve] * since)


def plan_times(skeleton: Skeleton, internode_m: float, settings: GrowthStageSettings) -> GrowthTimes:
    """When each branch of a skeleton begins, and its pace.

    Args:
        skeleton: As it is at last.
        internode_m: Length of an internode.
        settings: How it grows.
    """
    path_m = skeleton.arcs_m.copy()
    for number in np.flatnonzero(skeleton.parent_curve >= 0).tolist():  # parents first
        path_m[skeleton.branch(number)] += path_m[skeleton.parent_vertex[number]]
    longest_m = float(path_m.max()) * (1 + 1e-9)  # no rounding keeps a tip back
    start_m = min(settings.initial_internodes * internode_m, 0.5 * longest_m)
    front = LogisticFront(longest_m=longest_m, start_m=start_m)
    end = (1 - settings.finish_share) * (1 - 1e-6)
    shortest = _highest(
        lambda shortest: _last(skeleton, front, path_m, _SLOWEST * end, shortest) <= end, settings.branch_share
    )
    pace = _highest(lambda time: _last(skeleton, front, path_m, time, shortest) <= end, end)
    begins, ends = _ends(skeleton, front, path_m, pace, shortest)
    takes = _takes(skeleton, front, path_m)
    return GrowthTimes(
        front=front,
        path_m=path_m,
        base_m=path_m[skeleton.first],
        begins=begins,
        pace=np.where(takes > 0, (ends - begins) / np.where(takes > 0, takes, 1), pace),
    )


def _highest(fits: Callable[[float], bool], limit: float) -> float:
    """The highest number from 0 to limit that fits, of which all lower ones fit."""
    if fits(limit):
        return limit
    low, high = 0.0, limit
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low


def _takes(skeleton: Skeleton, front: LogisticFront, path_m: Array) -> Array:
    """(B,) time in which the front passes each branch."""
    return front.when(path_m[skeleton.first + skeleton.counts - 1]) - front.when(path_m[skeleton.first])


def _last(skeleton: Skeleton, front: LogisticFront, path_m: Array, pace: float, shortest: float) -> float:
    """The time at which the last branch ends."""
    return float(_ends(skeleton, front, path_m, pace, shortest)[1].max())


def _ends(skeleton: Skeleton, front: LogisticFront, path_m: Array, pace: float, shortest: float) -> tuple[Array, Array]:
    """Times (B,) at which branches begin and end, where the front takes pace in all, and a branch shortest or more."""
    takes = _takes(skeleton, front, path_m)
    lasts = np.maximum(pace * takes, shortest)
    rate = lasts / np.maximum(takes, 1e-300)
    when = front.when(path_m)
    begins = np.zeros(len(skeleton))
    for order in range(1, int(skeleton.order.max()) + 1):
        child = np.flatnonzero(skeleton.order == order)
        parent, springs = skeleton.parent_curve[child], skeleton.parent_vertex[child]
        since = when[springs] - when[skeleton.first[parent]]
        # A branch that is there from the beginning has no time of its own; its children begin with it.
        begins[child] = begins[parent] + np.where(takes[parent] > 0, rate[parent] * since, 0.0)
    return begins, begins + lasts
