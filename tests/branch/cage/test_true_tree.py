"""The cage of a whole simulated tree, against its skeleton."""

import json
from pathlib import Path

import numpy as np
import pytest
from usdfoliage.branch.cage.build import build_branch_cage, check_cage

from tests.support.branch_shapes import limit, off_axis, plant_of

TREE = Path(__file__).parents[4] / "shared" / "data" / "synthetic" / "tree_leaf_off" / "truth" / "skeleton.json"


@pytest.fixture(scope="module")
def plant():
    if not TREE.exists():
        pytest.skip("../shared/data/synthetic/tree_leaf_off is absent")
    tree = json.loads(TREE.read_text(encoding="utf-8"))
    nodes = np.array(tree["nodes"])[:, [0, 2, 1]] * [1, 1, -1]  # to Y up
    parent, order = tree["parent"], tree["order"]
    goes_on = {}
    for node, above in enumerate(parent):
        if above >= 0 and order[node] == order[above]:
            goes_on.setdefault(above, node)
    heads = [node for node, above in enumerate(parent) if goes_on.get(above) != node]
    branches, place = [], {}
    for head in sorted(heads, key=lambda node: (order[node], node)):
        own = [head]
        while own[-1] in goes_on:
            own.append(goes_on[own[-1]])
        radii = [tree["radius"][node] for node in own]
        carried = parent[head] >= 0
        if carried:
            own, radii = [parent[head], *own], [radii[0], *radii]
        branches.append((nodes[own], radii, *(place[parent[head]] if carried else (None, 0))))
        place |= {node: (len(branches) - 1, at) for at, node in enumerate(own) if at or not carried}
    return plant_of(*branches)


def test_every_branch_is_joined(plant):
    cage = build_branch_cage(plant)
    check = check_cage(cage)
    assert check.clean, check
    assert check.components == 1
    assert cage.dropped == ()
    assert set(cage.curve.tolist()) == set(range(len(plant)))


def test_away_from_forks_the_radius_is_met_to_a_percent(plant):
    plant = plant.up_to_order(2)
    cage = build_branch_cage(plant)
    points, quads = limit(cage, 1)
    on = np.repeat(cage.curve, 4)
    axes = [
        (plant.points_m[plant.branch(number)], plant.radius_m[plant.branch(number)]) for number in range(len(plant))
    ]
    errors = []
    for number, (axis, radius) in enumerate(axes):
        own = points[quads[on == number, 0]]
        apart, along = off_axis(own, axis, radius)
        far = (along > 2 * radius[0]) & (along < plant.lengths_m[number] - 2 * radius[-1])
        # Away from a junction: two radii of the parent, and one of the other branch, off the other's axis.
        others = [(child, radius) for child in np.flatnonzero(plant.parent_curve == number)]
        if number:
            others.append((plant.parent_curve[number], axes[plant.parent_curve[number]][1]))
        for other, thick in others:
            reach = 2 * thick.max() + radius[0]
            far &= off_axis(own, axes[other][0], np.full(len(axes[other][0]), reach))[0] > 1
        errors.append(np.abs(apart[far] - 1))
    error = np.concatenate(errors)
    assert len(error) > 10000
    assert np.median(error) < 0.004
    assert np.percentile(error, 95) < 0.01
