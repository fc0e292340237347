"""Validator of FoliageLobedLeafAPI: silhouette, skeleton, railroad ties and functions fit together."""

import numpy as np
from numpy.typing import NDArray
from pxr import Usd

from usdFoliageValidators import values
from usdFoliageValidators.findings import Findings, count, error, wrong_prim_type

TIES = ("kLength", "kTurn", "tLength", "tTurn")


def check_lobed_leaf(prim: Usd.Prim, _time: object) -> Findings:
    """A closed silhouette, a skeleton that is a tree, ties on its branches, functions of rising keys."""
    findings = wrong_prim_type(prim, "FoliageLobedLeafAPI", ("Mesh",))
    if findings:
        return findings
    silhouette = values.numbers(prim, "foliage:lobed:silhouettePoints", 3)
    if silhouette is None or len(silhouette) < 4 or not np.isfinite(silhouette).all():
        text = f"has {0 if silhouette is None else len(silhouette)} points; author 4 or more, finite"
        findings.append(error(prim, "LobedSilhouette", text, "foliage:lobed:silhouettePoints"))
    degree = values.number(prim, "foliage:lobed:silhouetteDegree")
    if degree not in (1, 2, 3):
        text = f"is {degree}; it must be 1, 2 or 3"
        findings.append(error(prim, "LobedSilhouetteDegree", text, "foliage:lobed:silhouetteDegree"))
    skeleton_findings, branches = _check_skeleton(prim)
    findings += skeleton_findings
    if branches:
        findings += _check_ties(prim, branches)
        for function in ("turn", "bend", "twist"):
            findings += _check_function(prim, function, branches)
    return findings


def _check_skeleton(prim: Usd.Prim) -> tuple[Findings, int]:
    """Findings, and the number of branches, 0 where it is not known."""
    points = values.numbers(prim, "foliage:lobed:skeletonPoints", 3)
    if points is None or len(points) < 2 or not np.isfinite(points).all():
        text = f"has {0 if points is None else len(points)} nodes; author 2 or more, finite"
        return [error(prim, "LobedSkeleton", text, "foliage:lobed:skeletonPoints")], 0
    findings: Findings = []
    arrays: dict[str, NDArray[np.int64]] = {}
    for name in ("skeletonParents", "skeletonBranches"):
        array = values.indices(prim, f"foliage:lobed:{name}")
        if array is None or len(array) != len(points):
            text = f"has {0 if array is None else len(array)} elements; author {len(points)}, one a node"
            findings.append(error(prim, "LobedSkeletonLength", text, f"foliage:lobed:{name}"))
        else:
            arrays[name] = array
    if findings:
        return findings, 0
    parents, branch = arrays["skeletonParents"], arrays["skeletonBranches"]
    own = np.arange(len(points))
    wrong = np.where(own == 0, parents != -1, (parents < 0) | (parents >= own))
    if wrong.any():
        text = f"is no earlier node in {count(wrong, 'nodes')}; each node stands after its parent, the base has -1"
        findings.append(error(prim, "LobedSkeletonParents", text, "foliage:lobed:skeletonParents"))
    used = np.unique(branch)
    if branch[0] != 0 or not np.array_equal(used, np.arange(len(used))):
        text = f"uses the numbers {used.tolist()}; branches are numbered from 0, the axis, without gaps"
        findings.append(error(prim, "LobedBranches", text, "foliage:lobed:skeletonBranches"))
        return findings, 0
    return findings, len(used)


def _check_ties(prim: Usd.Prim, branches: int) -> Findings:
    branch = values.indices(prim, "foliage:lobed:tie:branch")
    if branch is None or not len(branch):
        text = "is not authored; author the branch of each railroad tie"
        return [error(prim, "LobedTiesMissing", text, "foliage:lobed:tie:branch")]
    findings: Findings = []
    wrong = (branch < 0) | (branch >= branches)
    if wrong.any():
        text = f"is not 0 to {branches - 1} in {count(wrong, 'ties')}; name a branch of the skeleton"
        findings.append(error(prim, "LobedTieBranch", text, "foliage:lobed:tie:branch"))
    for name in TIES:
        attribute = f"foliage:lobed:tie:{name}"
        array = values.numbers(prim, attribute)
        if array is None or len(array) != len(branch):
            text = f"has {0 if array is None else len(array)} elements; author {len(branch)}, one a tie"
            findings.append(error(prim, "LobedTieLength", text, attribute))
            continue
        turns = name.endswith("Turn")
        wrong = ~(np.abs(array) <= 180) if turns else ~((array >= 0) & np.isfinite(array))
        if wrong.any():
            text = (
                f"is not {'-180 to 180 degrees' if turns else '0 or more'} in {count(wrong, 'ties')}; trace them again"
            )
            findings.append(error(prim, "LobedTieRange", text, attribute))
    return findings


def _check_function(prim: Usd.Prim, function: str, branches: int) -> Findings:
    counts_name, keys_name = f"foliage:lobed:{function}:keyCounts", f"foliage:lobed:{function}:keys"
    if not values.is_authored(prim, counts_name) and not values.is_authored(prim, keys_name):
        return []
    counts, keys = values.indices(prim, counts_name), values.numbers(prim, keys_name, 2)
    counts = np.zeros(0, np.int64) if counts is None else counts
    keys = np.zeros((0, 2)) if keys is None else keys
    if len(counts) not in (0, branches) or (counts < 0).any() or counts.sum() != len(keys):
        text = (
            f"has {len(counts)} counts that sum to {counts.sum()} for {len(keys)} keys; author one count for each of "
            f"the {branches} branches, together the number of keys"
        )
        return [error(prim, "LobedFunctionCounts", text, counts_name)]
    positions = keys[:, 0]
    same_branch = np.diff(np.repeat(np.arange(len(counts)), counts)) == 0
    falling = same_branch & ~(np.diff(positions) > 0)
    if not np.isfinite(keys).all() or not ((positions >= 0) & (positions <= 1)).all() or falling.any():
        text = "needs finite keys whose positions are 0 to 1 and rise within a branch; sort them"
        return [error(prim, "LobedFunctionKeys", text, keys_name)]
    return []
