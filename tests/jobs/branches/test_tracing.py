"""Clouds whose branches are traced more coarsely, kept where they stand free, or refused."""

from dataclasses import replace

import numpy as np
import pytest
from usdfoliage.branch.photographs.joined import StemPiece
from usdfoliage.branch.tracing.roots import RootSettings
from usdfoliage.branch.tracing.settings import BranchSettings
from usdfoliage.jobs.branches.known_stems import KnownStems, describe_known_stems
from usdfoliage.jobs.branches.run import BranchesRequest, find_branches
from usdfoliage.jobs.branches.tracing import NoStemsError, trace_cloud
from usdfoliage.jobs.plant_cloud import PlantCloudRequest

from tests.support.branch_clouds import cone
from tests.support.branch_shapes import plant_of
from tests.support.cloud_files import write_ply

FEET_M = ((0.05, 0.02), (-0.05, 0.03), (0.01, -0.06))


def noisy_leaves(rng, count: int, middle_m, spread_m, noise_m: float, points: int = 400) -> list[np.ndarray]:
    """Flat leaves 9 cm long that lie any way, as blurred as photographs show them."""
    leaves = []
    for _ in range(count):
        normal = rng.normal([0, 1, 0], 0.5)
        normal /= np.linalg.norm(normal)
        along = np.cross(normal, rng.normal(size=3))
        along /= np.linalg.norm(along)
        radius, turn = np.sqrt(rng.uniform(0, 1, points)), rng.uniform(0, 2 * np.pi, points)
        flat = np.column_stack([0.045 * radius * np.cos(turn), 0.025 * radius * np.sin(turn)])
        points_m = flat @ np.stack([along, np.cross(normal, along)]) + rng.normal(middle_m, spread_m)
        leaves.append(points_m + rng.normal(0, noise_m, points)[:, None] * normal)
    return leaves


def trace(path, points_m, **options):
    write_ply(path, points_m)
    cloud = PlantCloudRequest(path=path, roots=RootSettings(), up="Y")
    return trace_cloud(cloud, BranchSettings(), {}, **options)


def test_stems_of_a_herb_are_distinguished_from_its_blurred_leaves(tmp_path):
    noise_m = 0.002
    rng = np.random.default_rng(0)
    stems = [
        cone([x, 0, z], [2.2 * x, 0.3, 2.2 * z], (0.005, 0.004), 5000, 3 + number, noise_m)
        for number, (x, z) in enumerate(FEET_M)
    ]
    points_m = np.concatenate([*stems, *noisy_leaves(rng, 30, [0, 0.36, 0], [0.08, 0.02, 0.08], noise_m, 1500)])
    found = trace(tmp_path / "herb.ply", points_m, needs_stems=True)
    skeleton = found.traced.skeleton
    assert any(each.code == "traced-coarsely" for each in found.remarks)
    assert len(skeleton) < 100  # traced finely there are 2,058
    stems = np.flatnonzero((skeleton.order == 0) & (skeleton.lengths_m > 0.15))
    assert len(stems) == len(FEET_M)
    # They begin at the feet; the plant's first root is the origin.
    feet = found.plant.asset_from_cloud[:3, :3] @ np.array([[x, 0, z] for x, z in FEET_M]).T
    feet = (feet + found.plant.asset_from_cloud[:3, 3:]).T
    away_m = np.linalg.norm(skeleton.points_m[skeleton.first[stems], None] - feet, axis=2)
    assert away_m.min(axis=0).max() < 0.02


def test_a_hedge_is_refused_where_stems_are_needed(tmp_path):
    rng = np.random.default_rng(1)
    points_m = np.concatenate(noisy_leaves(rng, 40, [0, 0.12, 0], [0.09, 0.05, 0.05], 0.002))
    points_m = points_m[points_m[:, 1] > 0]
    with pytest.raises(NoStemsError, match="no stem is seen at a root"):
        trace(tmp_path / "hedge.ply", points_m, needs_stems=True)


def test_of_stems_that_were_found_otherwise_remarks_concern_these(tmp_path):
    """Their places are in the asset's frame, and nothing is reported of a trace of which nothing is left."""
    rng = np.random.default_rng(1)
    points_m = np.concatenate(noisy_leaves(rng, 40, [0, 0.12, 0], [0.09, 0.05, 0.05], 0.002))
    points_m = points_m[points_m[:, 1] > 0]
    # Their own frame is turned, moved and twice as large: own = 2 * (z, y, -x) + moved_m.
    own_from_cloud = np.eye(4)
    own_from_cloud[:3, :3] = 2 * np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    own_from_cloud[:3, 3] = moved_m = np.array([3.0, 0.4, -1])

    def in_own(place_m):
        return own_from_cloud[:3, :3] @ np.array(place_m) + moved_m

    foot_m, tip_m, apart_m = (0.02, 0.0, 0.01), (0.02, 0.2, 0.01), (0.12, 0.1, 0.31)
    known = KnownStems(
        skeleton=plant_of(([in_own(foot_m), in_own(tip_m)], 0.004, None, 0)),
        own_from_cloud=own_from_cloud,
        leaves=20,
        turned=np.arange(4, dtype=np.int32),
        unjoined=np.arange(3, dtype=np.int32),
        apart=(StemPiece(length_m=0.02, middle_m=in_own(apart_m)),),
    )
    found = trace(tmp_path / "hedge.ply", points_m, needs_stems=True, find_stems=lambda thickest_m: known)
    assert found.stems is known
    np.testing.assert_allclose(found.traced.skeleton.points_m, [[0, 0, 0], [0, 0.2, 0]], atol=1e-6)
    assert found.traced.skeleton.radius_m == pytest.approx(0.002)
    texts = {each.code: each.text for each in found.remarks}
    assert not {"cloud-up", "cloud-thinned", "roots-missing"} & set(texts)
    assert "1 branches, from the soil at 1 places, which lead to 17 of 20 leaves" in texts["stems-of-photographs"]
    assert "10 mm long at (0.100, 0.100, 0.300)" in texts["stems-apart-left-out"]
    assert texts["many-leaves-turned-to-stems"].startswith("4 of 20 leaves")
    assert "20%" in texts["many-leaves-turned-to-stems"]


@pytest.mark.parametrize(("turned", "code"), [(3, "leaves-turned-to-stems"), (4, "many-leaves-turned-to-stems")])
def test_more_than_15_of_100_turned_leaves_are_a_warning(turned, code):
    stems = KnownStems(
        skeleton=plant_of(([(0, 0, 0), (0, 1, 0)], 0.01, None, 0)),
        own_from_cloud=np.eye(4),
        leaves=20,
        turned=np.arange(turned, dtype=np.int32),
    )
    remarks = [each for each in describe_known_stems(stems, np.eye(4)) if "turned" in each.code]
    assert [each.code for each in remarks] == [code]
    assert (remarks[0].severity == "warning") == (turned == 4)


@pytest.mark.parametrize(
    ("certainty", "turned", "code"),
    [
        (0.5, 9, "leaves-turned-to-stems"),
        (0.5, 14, "leaves-turned-to-stems"),
        (0.5, 15, "many-leaves-turned-to-stems"),
        (0.85, 6, "leaves-turned-to-stems"),
        (0.85, 7, "many-leaves-turned-to-stems"),
    ],
)
def test_so_many_turned_leaves_as_had_uncertain_bases_are_no_warning(certainty, turned, code):
    """Of 20 leaves 10 have the wrong base at a certainty of 0.5, 3 at 0.85; spreads are 2.2 and 1.6."""
    stems = KnownStems(
        skeleton=plant_of(([(0, 0, 0), (0, 1, 0)], 0.01, None, 0)),
        own_from_cloud=np.eye(4),
        leaves=20,
        certainty=np.full(20, certainty),
        turned=np.arange(turned, dtype=np.int32),
    )
    (found,) = [each for each in describe_known_stems(stems, np.eye(4)) if "turned" in each.code]
    assert found.code == code
    assert ("10 of the 20" if certainty == 0.5 else "3 of the 20") in found.text or code.startswith("many")


def test_figures_of_such_stems_are_none_of_the_trace_of_the_cloud(tmp_path):
    """No circles that are believed, and no share of the cloud that tracing left out as leaves."""
    points_m = np.concatenate(noisy_leaves(np.random.default_rng(1), 40, [0, 0.12, 0], [0.09, 0.05, 0.05], 0.002))
    write_ply(tmp_path / "hedge.ply", points_m[points_m[:, 1] > 0])
    stems = KnownStems(
        skeleton=plant_of(([(0, 0, 0), (0, 0.1, 0), (0, 0.2, 0)], 0.004, None, 0)), own_from_cloud=np.eye(4)
    )
    request = BranchesRequest(
        cloud=PlantCloudRequest(path=tmp_path / "hedge.ply", roots=RootSettings(), up="Y"),
        output=tmp_path,
        name="hedge",
        settings=BranchSettings(),
        needs_stems=True,
    )
    found = find_branches(request, None, {}, find_stems=lambda thickest_m: stems)
    assert found.stems is stems
    assert not [row for row in found.rows if "circles" in row.remark]
    assert "cloud-leaves-left-out" not in {each.code for each in found.remarks}
    # A stem without side branches shows no internode; that of the trace is none of it.
    assert "internodeLength" not in found.made.skeleton.growth
    assert not [row for row in found.rows if row.name == "internode"]
    of_cloud = find_branches(replace(request, needs_stems=False), None, {})
    assert [row for row in of_cloud.rows if "circles" in row.remark]


def test_points_too_far_apart_to_show_leaves_give_a_tree_all_the_same(tmp_path):
    """A crown seen from an aircraft, without a stem: nothing is round, and branches are traced to all of it."""
    rng = np.random.default_rng(0)
    crown_m = rng.normal(size=(800, 3))
    crown_m *= 3 * np.cbrt(rng.random((800, 1))) / np.linalg.norm(crown_m, axis=1, keepdims=True)
    crown_m += [0, 7, 0]
    stem_m = np.column_stack([rng.normal(0, 0.1, 12), np.linspace(0, 4.2, 12), rng.normal(0, 0.1, 12)])
    points_m = np.concatenate([crown_m, stem_m])
    plain = trace(tmp_path / "tree.ply", points_m)
    needed = trace(tmp_path / "tree.ply", points_m, needs_stems=True)
    assert not needed.traced.knows_leaves
    np.testing.assert_array_equal(needed.traced.skeleton.points_m, plain.traced.skeleton.points_m)
    assert [each.code for each in needed.remarks] == [each.code for each in plain.remarks]
    assert len(needed.traced.skeleton) > 50
