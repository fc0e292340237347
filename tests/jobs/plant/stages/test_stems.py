"""Where stems cannot be looked for in photographs, branches are those of the cloud, and a remark gives the reason.

What is known before they are looked for: the box of the plant, its cameras upright, and where leaves were found.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from usdfoliage.branch.photographs.joined import JoinedStems, StemPiece
from usdfoliage.branch.photographs.no_stems import NoStems
from usdfoliage.errors import CaptureError, FitError, WriteError
from usdfoliage.jobs.branches.known_stems import KnownStems
from usdfoliage.jobs.branches.tracing import NoStemsError
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.plant.stages import parts, stems
from usdfoliage.jobs.plant.stages.models import CapturedLeaves
from usdfoliage.jobs.plant.summary import read_summary

from tests.support.branch_shapes import plant_of
from tests.support.drawn_stems import camera_at
from tests.support.leaves.proposals import flat_leaves


def refuse_with(error: Exception):
    def refuse(*arguments, **options):
        raise error

    return refuse


@pytest.fixture
def call(tmp_path, monkeypatch):
    """A task whose cloud is traced by a stand-in, which looks for stems in photographs and ends as it is given."""
    out = tmp_path / "result"
    out.mkdir()
    monkeypatch.setattr(parts, "plant_capture", lambda call: tmp_path)
    return SimpleNamespace(
        request=SimpleNamespace(name="herb"),
        settings=BuildSettings(),
        out=out,
        progress=None,
        has=lambda name: name == parts.CLOUD,
    )


def trace_by(monkeypatch, error: Exception):
    """What follows in the trace of the cloud, once the photographs have no stems."""

    def find_branches(request, fitted, seconds, progress, find_stems):
        assert find_stems(0.001) is None
        raise error

    monkeypatch.setattr(parts, "find_branches", find_branches)


@pytest.mark.parametrize(
    ("error", "code"), [(NoStemsError("a hedge"), "branches-left-out"), (FitError("a line"), "part-failed")]
)
def test_the_cloud_is_traced_on_where_photographs_cannot_be_searched(call, monkeypatch, error, code):
    failed = CaptureError("000.jpg cannot be read", "copy it again")
    monkeypatch.setattr(stems, "find_photographed_stems", refuse_with(failed))
    trace_by(monkeypatch, error)
    assert parts.trace_branches(call) == ()
    remarks = read_summary(call.out).remarks
    assert [each.code for each in remarks] == [code, "stems-not-looked-for"]
    assert remarks[1].text == "stems were not looked for in the photographs: 000.jpg cannot be read"
    assert "copy it again" in str(remarks[1].remedy)


def test_what_fails_here_and_now_is_no_result(call, monkeypatch):
    monkeypatch.setattr(stems, "find_photographed_stems", refuse_with(WriteError("the disk is full")))
    trace_by(monkeypatch, FitError("a line"))
    with pytest.raises(WriteError, match="disk is full"):
        parts.trace_branches(call)


def test_reasons_are_remarks_of_different_codes(call, monkeypatch):
    for reason in NoStems:
        failures = []
        monkeypatch.setattr(stems, "find_photographed_stems", lambda call, thickest_m, reason=reason: reason)
        assert stems.try_photographed_stems(call, failures, 0.001) is None
        assert [each.code for each in failures] == [stems.describe_no_stems(reason).code]
    assert len({stems.describe_no_stems(reason).code for reason in NoStems}) == len(NoStems)


@pytest.mark.parametrize(("roots", "codes"), [("0.1,0,0.2", ["stems-from-given-roots"]), ("2", []), ("auto", [])])
def test_given_roots_turn_stems_of_photographs_off_and_a_remark_states_it(call, monkeypatch, roots, codes):
    asked = []

    def find_branches(request, fitted, seconds, progress, find_stems):
        asked.append(find_stems is not None)
        raise FitError("a line")

    monkeypatch.setattr(parts, "find_branches", find_branches)
    branches = replace(BuildSettings().branches, roots=roots)
    call.settings = replace(BuildSettings(), branches=branches)
    parts.trace_branches(call)
    assert [each.code for each in read_summary(call.out).remarks] == ["part-failed", *codes]
    assert asked == [not codes]


def test_the_box_of_a_plant_begins_where_it_stands_and_leaves_out_what_is_far():
    points_m = np.random.default_rng(0).uniform((-1, -1, -2), (1, 3, 2), (200_000, 3))
    points_m[:20] = 50.0
    low_m, high_m = stems.plant_box(points_m, 0.5)
    beside_m = 0.03 * 4
    np.testing.assert_allclose(low_m, [-1 - beside_m, 0.5, -2 - beside_m], atol=0.03)
    np.testing.assert_allclose(high_m, [1 + beside_m, 3 + beside_m, 2 + beside_m], atol=0.03)
    assert stems.plant_box(points_m, None)[0, 1] == pytest.approx(-1 - beside_m, abs=0.03)
    assert stems.plant_box(points_m, 60.0) is None
    assert stems.plant_box(np.zeros((0, 3)), None) is None


def test_a_turned_camera_sees_the_turned_world_as_before():
    camera = camera_at((0.3, 0.2, 0.6), (0, 0.15, 0))
    upright_from_world = np.eye(4)
    upright_from_world[:3, :3] = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    upright_from_world[:3, 3] = (1, 2, 3)
    points_m = np.random.default_rng(0).uniform(-0.1, 0.1, (20, 3))
    upright_m = points_m @ upright_from_world[:3, :3].T + upright_from_world[:3, 3]
    there, _ = stems.turned_camera(camera, upright_from_world).project(upright_m)
    here, _ = camera.project(points_m)
    np.testing.assert_allclose(there, here, atol=1e-9)


@pytest.mark.parametrize(("certainty", "end"), [(0.9, 1.0), (0.5, 0.85)])
def test_a_blade_is_known_to_its_apex_only_where_its_base_is_certain(certainty, end):
    """A line on what is not of the blade may be its petiole, which is at the apex where the two were exchanged."""
    leaves = flat_leaves([(0, 0, 0)], 0.1)
    places = stems.leaf_places(leaves, np.array([certainty]))
    np.testing.assert_allclose(places.bases_m, [[0, 0, 0]])
    np.testing.assert_allclose(places.apices_m, [[0, 0.1, 0]], atol=1e-12)
    assert places.blades_m[:, 1].min() == pytest.approx(0.1 * 0.15)
    assert places.blades_m[:, 1].max() == pytest.approx(0.1 * end)
    np.testing.assert_array_equal(stems.leaf_places(leaves, None).certainty, [0.5])


@pytest.fixture
def photographed(call, monkeypatch):
    """A call whose capture is a cloud of 0.4 m in its own frame, with Z up, and one camera; and what was asked for."""
    upright = np.eye(4)
    upright[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    camera = camera_at((0.3, 0.6, 0.2), (0, 0, 0.2))
    view = SimpleNamespace(lens=SimpleNamespace(pinhole=lambda pose: camera), cam_from_world=camera.cam_from_world)
    capture = SimpleNamespace(
        asset_from_world=upright,
        asset_from_capture=upright,
        settings=SimpleNamespace(metres_per_unit=1.0),
        views=[view],
    )
    points_m = np.random.default_rng(0).uniform((-0.1, -0.1, 0), (0.1, 0.1, 0.4), (5000, 3))
    leaves = flat_leaves([(0, 0.1, 0), (0, 0.2, 0), (0, 0.3, 0)], 0.05)
    found = CapturedLeaves(fitted=SimpleNamespace(leaves=leaves), own_from_capture=upright)
    asked = []
    call.threads, call.result_of, call.has = 1, lambda name: name, lambda name: True
    monkeypatch.setattr(stems, "plant_capture", lambda call: call.out)
    monkeypatch.setattr(stems, "read_capture", lambda folder: capture)
    monkeypatch.setattr(stems, "read_cloud", lambda path, scale: SimpleNamespace(points_m=points_m))
    monkeypatch.setattr(stems, "stand_height_m", lambda call: 0.02)
    monkeypatch.setattr(stems, "read_views", lambda capture, progress: SimpleNamespace(views=[]))
    monkeypatch.setattr(stems, "read_captured_leaves", lambda folder: found)

    def reconstruct(views, box_m, places, settings, progress, threads):
        asked.append((box_m, places))
        return JoinedStems(
            skeleton=plant_of(([(0, 0.02, 0), (0, 0.3, 0)], 0.002, None, 0)),
            joined=np.ones(1, bool),
            leaf=np.array([1, -1, 0]),
            turned=np.array([False, False, True]),
            apart=(StemPiece(length_m=0.01, middle_m=np.array([0.1, 0.2, 0.3])),),
        )

    monkeypatch.setattr(stems, "reconstruct_stems", reconstruct)
    return call, asked


def test_what_photographs_show_is_handed_on_with_the_numbers_of_leaves(photographed):
    call, asked = photographed
    known = stems.find_photographed_stems(call, 0.001)
    assert isinstance(known, KnownStems)
    assert (known.leaves, known.turned.tolist(), known.unjoined.tolist()) == (3, [2], [1])
    assert [part.length_m for part in known.apart] == [0.01]
    ((box_m, places),) = asked
    assert box_m[0, 1] == 0.02
    assert box_m[1, 1] == pytest.approx(0.4, abs=0.02)  # what was up in the capture is Y
    np.testing.assert_allclose(places.bases_m, [(0, 0.1, 0), (0, 0.2, 0), (0, 0.3, 0)], atol=1e-12)


def test_thick_stems_and_empty_clouds_are_reasons(photographed, monkeypatch):
    call, asked = photographed
    assert stems.find_photographed_stems(call, 1.0) is NoStems.TOO_THICK
    monkeypatch.setattr(stems, "stand_height_m", lambda call: 5.0)
    assert stems.find_photographed_stems(call, 0.001) is NoStems.NOTHING_STANDS
    assert not asked
    monkeypatch.setattr(stems, "stand_height_m", lambda call: 0.02)
    monkeypatch.setattr(stems, "reconstruct_stems", lambda *each, **other: NoStems.NO_LINES)
    assert stems.find_photographed_stems(call, 0.001) is NoStems.NO_LINES
