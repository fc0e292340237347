"""The benchmark of branches: what it measures of skeletons that are known."""

import numpy as np
import pytest
from usdfoliage.branch.cage.build import build_branch_cage

from tests.support.branch_shapes import fork, plant_of, random_tree
from tools.bench import branch_surface
from tools.bench import branches as bench
from tools.bench.branch_similarity import compare_trees
from tools.bench.branch_truth import score_skeleton, spanning_skeleton


def test_a_tree_is_like_itself():
    tree = random_tree(3)
    similarity = compare_trees(tree, tree)
    assert (similarity.shape, similarity.geometry, similarity.structure) == (0, 0, 0)
    assert similarity.total == 1


@pytest.mark.parametrize("seed", [1, 5, 6])
def test_another_tree_is_less_similar_whichever_comes_first(seed):
    one, two = random_tree(3), random_tree(seed)
    total = compare_trees(one, two).total
    assert 0 <= total < 0.95
    assert compare_trees(two, one).total == pytest.approx(total)


def test_a_branch_more_costs_its_length_in_structure():
    trunk = (np.array([[0, 0, 0], [0, 2, 0]], float), 0.05, None, 0)
    side = (np.array([[0, 2, 0], [1, 2, 0]], float), 0.02, 0, 1)
    similarity = compare_trees(plant_of(trunk), plant_of(trunk, side))
    assert similarity.structure == pytest.approx(1 / 5)  # one metre of two and three


def test_a_line_of_points_spans_one_branch():
    line = np.linspace([0, 0, 0], [0, 3, 0], 400)
    skeleton = spanning_skeleton(line, np.zeros(3), 0.02)
    assert len(skeleton) == 1
    assert skeleton.lengths_m[0] == pytest.approx(3, abs=0.04)
    assert skeleton.points_m[0, 1] < skeleton.points_m[-1, 1]


def test_what_is_true_scores_full_and_half_of_it_half():
    true = fork(60)
    scores = score_skeleton(true, true)
    assert (scores.recall, scores.precision, scores.ancestry) == (1, 1, 1)
    assert scores.radius_error == pytest.approx(0, abs=1e-9)
    assert scores.length_ratio == pytest.approx(1)
    trunk = true.up_to_order(0)
    part = score_skeleton(trunk, true)
    assert part.precision == 1
    assert part.recall_by_order[0] == 1
    assert part.recall_by_order[2] == 0
    assert np.isnan(part.recall_by_order[4])
    assert part.length_ratio == pytest.approx(2 / true.lengths_m.sum())


def test_a_cylinder_measures_what_it_is():
    trunk = plant_of((np.array([[0, 0, 0], [0, 2, 0]], float), 0.05, None, 0))
    assert branch_surface.diameter_at(trunk, 1.3) == pytest.approx(0.1)
    assert np.isnan(branch_surface.diameter_at(trunk, 2.5))
    assert branch_surface.cone_volume(trunk) == pytest.approx(np.pi * 0.05**2 * 2)
    cage = build_branch_cage(trunk)
    points, quads = branch_surface.limit_surface(cage)
    assert branch_surface.radius_deviations(trunk, cage, points).max() < 0.01
    turn = np.linspace(0, 2 * np.pi, 3000)
    cloud = np.stack([0.06 * np.cos(97 * turn), np.linspace(0, 2, 3000), 0.06 * np.sin(97 * turn)], axis=1)
    away = branch_surface.measure_surface(points, quads, cloud)
    assert away.scan_to_mesh[0] == pytest.approx(0.01, abs=0.002)
    assert away.mesh_to_scan[0] > 0.009


def test_published_models_of_either_kind_are_read(tmp_path):
    path = tmp_path / "tree_qsm.csv"
    path.write_text(
        "# cylinders\nid,parent,branch,order,start_x,start_y,start_z,axis_x,axis_y,axis_z,length,radius\n"
        "1,0,1,0,0,0,0,0,0,1,2,0.1\n2,1,2,1,0,0,2,1,0,0,1,0.05\n"
    )
    model = bench.read_model(path)
    assert (model.diameter, model.height, model.length) == (0.2, 2, 3)
    assert model.volume == pytest.approx(np.pi * (0.1**2 * 2 + 0.05**2))
    path.write_text("# cylinders. radius,length,start_xyz,axis_xyz\n0.1,2,0,0,0,0,0,1,0,0\n")
    assert bench.read_model(path).diameter == 0.2
