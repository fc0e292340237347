"""Which pairs of photographs agree on how the camera turned, where surfaces that look the same mislead some.

Equal walls or tiles give pairs with many matches and a wrong motion.
Such pairs agree among themselves, so that their number proves nothing. What people photograph in order is near in
order, and that decides.

Source: Govindu, Lie-algebraic averaging for globally consistent motion estimation; Chatterjee and Govindu, Efficient
and robust large-scale rotation averaging (redescending weights).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix, diags_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

_STILL_RAD = 1e-6  # turns of cameras below which another round changes nothing


@dataclass(frozen=True, kw_only=True)
class ViewGraphSettings:
    """How pairs that agree are found."""

    # Pairs whose turns differ by less than this from those of the cameras agree at first; the limit is then halved
    # down to precise_deg, or to spread times the median difference of those that agree, whichever is larger.
    consistent_deg: float = 5.0
    precise_deg: float = 0.6
    spread: float = 4.0
    # Matches beyond this number do not count: equal walls have as many as anything.
    counted_matches: float = 100.0
    # Photographs that follow each other count so many times: their matches in the trees that are tried, and their
    # pairs in the number that agrees with a tree.
    in_order: float = 100.0
    agreeing_in_order: float = 5.0
    trees: int = 200
    rounds: int = 30  # for each limit


@dataclass(frozen=True, kw_only=True, eq=False)
class PairTurns:
    """How cameras turned between photographs."""

    first: NDArray[np.int64]  # (P,), numbers of photographs
    second: NDArray[np.int64]  # (P,)
    turn: Array  # (P, 3, 3), the second camera's axes from the first's
    matches: Array  # (P,), that this motion explains


@dataclass(frozen=True, kw_only=True, eq=False)
class PairAgreement:
    """How pairs agree with one turn for each camera."""

    off_rad: Array  # (P,), by which the turn of a pair differs from that of the cameras
    limit_rad: float  # of those that agree


def average_turns(
    pairs: PairTurns, photos: int, settings: ViewGraphSettings = ViewGraphSettings()
) -> PairAgreement | None:
    """The turns of the cameras that most pairs agree with, and by how much each pair differs from them.

    Pairs that mislead by a degree or two are recognised once those that mislead by more have lost their weight, so
    that the limit falls in steps.

    Args:
        pairs: Of the photographs in the order in which they were taken; the last is near the first.
        photos: How many there are.
        settings: How.

    Returns:
        None where the photographs do not hang together.
    """
    first, second = pairs.first, pairs.second
    apart = (second - first) % photos
    follows = np.minimum(apart, photos - apart) <= 1
    weight = pairs.matches * np.where(follows, settings.in_order, 1.0)
    links = coo_matrix((weight, (first, second)), shape=(photos, photos)).tocsr()
    if not len(first) or connected_components(links, directed=False)[0] > 1:
        return None
    turns = Rotation.from_matrix(pairs.turn)
    cameras = _best_tree(pairs, weight, follows, photos, settings)
    limit_rad = float(np.radians(settings.consistent_deg))
    share = np.minimum(pairs.matches, settings.counted_matches) / settings.counted_matches
    while True:
        for _ in range(settings.rounds):
            # By how much each pair wants its cameras turned in the world's axes.
            wanted = (cameras[second].inv() * turns * cameras[first]).as_rotvec()
            strength = share / (1 + (np.linalg.norm(wanted, axis=1) / limit_rad) ** 2) ** 2
            step = _spread(first, second, strength, wanted, photos)
            cameras = cameras * Rotation.from_rotvec(step)
            if np.abs(step).max() < _STILL_RAD:
                break
        off_rad = np.asarray((turns.inv() * cameras[second] * cameras[first].inv()).magnitude())
        agree = off_rad < limit_rad
        lowest_rad = np.radians(settings.precise_deg)
        if agree.any():
            lowest_rad = max(lowest_rad, settings.spread * np.median(off_rad[agree]))
        if limit_rad <= lowest_rad or not agree.any():
            return PairAgreement(off_rad=off_rad, limit_rad=limit_rad)
        limit_rad = max(limit_rad / 2, float(lowest_rad))


def _best_tree(
    pairs: PairTurns, weight: Array, follows: NDArray[np.bool_], photos: int, settings: ViewGraphSettings
) -> Rotation:
    """The cameras' turns along the tree that most pairs agree with: the strongest one, or one of many near it.

    One wrong pair of photographs that follow each other spoils a tree, and may be among the strongest.
    """
    rng = np.random.default_rng(0)
    turns, limit_rad = Rotation.from_matrix(pairs.turn), np.radians(settings.consistent_deg)
    counts = np.where(follows, settings.agreeing_in_order, 1.0)
    best, best_count = Rotation.identity(photos), -1.0
    for number in range(settings.trees):
        tried = weight if number == 0 else weight * rng.exponential(size=len(weight))
        cameras = _along_tree(pairs.first, pairs.second, turns, tried, photos)
        off_rad = (turns.inv() * cameras[pairs.second] * cameras[pairs.first].inv()).magnitude()
        count = float(counts[off_rad < limit_rad].sum())
        if count > best_count:
            best, best_count = cameras, count
    return best


def _along_tree(
    first: NDArray[np.int64], second: NDArray[np.int64], turns: Rotation, weight: Array, photos: int
) -> Rotation:
    """The cameras' turns along the tree of the strongest pairs."""
    tree = minimum_spanning_tree(csr_matrix((1 / weight, (first, second)), shape=(photos, photos)))
    order, before = breadth_first_order(tree + tree.T, 0, directed=False)
    pair_of = {(int(a), int(b)): k for k, (a, b) in enumerate(zip(first, second, strict=True))}
    matrices = np.zeros((photos, 3, 3))
    matrices[0] = np.eye(3)
    turn = turns.as_matrix()
    for camera in order[1:].tolist():
        parent = int(before[camera])
        forward = pair_of.get((parent, camera))
        step = turn[pair_of[camera, parent]].T if forward is None else turn[forward]
        matrices[camera] = step @ matrices[parent]
    return Rotation.from_matrix(matrices)


def _spread(first: NDArray[np.int64], second: NDArray[np.int64], strength: Array, wanted: Array, photos: int) -> Array:
    """(N, 3), the small turns of the cameras that meet what pairs want best; the first camera stays."""
    count = len(first)
    rows = np.repeat(np.arange(count), 2)
    columns = np.column_stack([first, second]).ravel()
    signs = np.tile([-1.0, 1.0], count)
    differences = coo_matrix((signs, (rows, columns)), shape=(count, photos)).tocsr()[:, 1:]
    weighted = diags_array(strength) @ differences
    normal = (differences.T @ weighted).tocsc() + 1e-12 * coo_matrix(np.eye(photos - 1)).tocsc()
    step = np.zeros((photos, 3))
    step[1:] = np.column_stack([spsolve(normal, weighted.T @ wanted[:, axis]) for axis in range(3)])
    return step
