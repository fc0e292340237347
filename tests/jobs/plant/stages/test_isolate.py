"""The stage that separates the plant from what is around it: a potted plant, with depth as matching leaves it."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from usdfoliage.capture.cloud.model import Cloud
from usdfoliage.capture.cloud_files.ply import read_cloud, write_cloud
from usdfoliage.capture.folder.read import read_capture, read_views
from usdfoliage.capture.lens import Lens
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.isolation.plant import PointKind
from usdfoliage.jobs.plant.settings import BuildSettings, IsolationStageSettings
from usdfoliage.jobs.plant.stages.isolate import GIVEN_DEPTH, has_drawn_masks, is_floorless, isolate_capture
from usdfoliage.jobs.plant.summary import read_summary
from usdfoliage.remarks import warnings_of

from tests.support.captures import look_at, write_depth, write_text_model
from tests.support.isolated_plants import potted_plant
from tests.support.small_builds import digests

SIZE = (320, 240)
VIEWS = 6
LENS = Lens(model="PINHOLE", width_px=SIZE[0], height_px=SIZE[1], parameters=(250.0, 250.0, 160.0, 120.0))


@pytest.fixture(scope="module")
def result(tmp_path_factory) -> Path:
    """A cloud's result: photographs and depth of the points of a potted plant."""
    folder = tmp_path_factory.mktemp("cloud")
    capture = folder / "capture" / "fern"
    scene = potted_plant()
    poses = {}
    for number in range(VIEWS):
        turn = number * 2 * np.pi / VIEWS
        place = (0.9 * np.cos(turn), 0.85, 0.9 * np.sin(turn))
        camera = Pinhole(width_px=SIZE[0], height_px=SIZE[1], focal_px=(250, 250), center_px=(160, 120),
                         cam_from_world=look_at(place, (0, 0.3, 0)))  # fmt: skip
        poses[f"{number}.png"] = camera.cam_from_world
        depth_m, srgb = splat(camera, scene.points_m, scene.srgb)
        (capture / "images").mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(capture / "images" / f"{number}.png"), srgb[..., ::-1])
        write_depth(capture / "depth" / f"{number}.exr", depth_m)
    write_text_model(capture / "cameras", poses, [LENS])
    (capture / "capture.toml").write_text('up_axis = "Y"\nmetres_per_unit = 1.0\n')
    count = len(scene.points_m)
    write_cloud(
        capture / "cloud.ply",
        Cloud(
            points_m=scene.points_m, normals=np.zeros((count, 3), np.float32), srgb=scene.srgb,
            confidence=np.ones(count, np.float32), views=np.full(count, 2, np.int32),
        ),
    )  # fmt: skip
    return folder


def splat(camera: Pinhole, points_m: np.ndarray, colors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depth, 0 between points, and a photograph on black."""
    places, depth_m = camera.project(points_m)
    inside = ((places >= 0) & (places < SIZE)).all(axis=1) & (depth_m > 0)
    order = np.flatnonzero(inside)[np.argsort(-depth_m[inside])]
    column, row = places[order].astype(int).T
    depth, srgb = np.zeros(SIZE[::-1]), np.zeros((*SIZE[::-1], 3), np.uint8)
    depth[row, column], srgb[row, column] = depth_m[order], colors[order]
    return depth, srgb


def run(result: Path, out: Path, given_depth: Path | None = None, **changes: Any) -> Path:
    """The stage's result, in out."""
    settings = replace(BuildSettings(), isolation=IsolationStageSettings(**changes))
    call = SimpleNamespace(
        out=out,
        inputs=SimpleNamespace(name="fern", has_depth=given_depth is not None, has_cameras=True),
        settings=settings,
        threads=2,
        progress=None,
        report_parts=None,
        task=SimpleNamespace(name="isolation"),
        store=SimpleNamespace(folder=out.parent),
        request=SimpleNamespace(capture=given_depth),
        result_of=lambda _: result,
    )
    out.mkdir(parents=True)
    assert isolate_capture(call) == ()  # type: ignore[arg-type]
    return out


def test_the_result_is_a_capture_of_the_plant_alone(result: Path, tmp_path: Path) -> None:
    out = run(result, tmp_path / "out")
    capture = read_capture(out / "capture" / "fern")
    assert len(capture.views) == VIEWS
    scene = potted_plant()
    cloud = read_cloud(out / "capture" / "fern" / "cloud.ply")
    assert len(cloud) == pytest.approx(int(scene.of("plant").sum()), rel=0.03)
    masks = [view.mask for view in read_views(capture).views]
    for view, mask in zip(capture.views, masks, strict=True):
        assert mask is not None
        camera = view.lens.pinhole(view.cam_from_world)
        # One colour for each kind: the shell of leaves is seen through in places.
        marked = np.where(scene.of("plant")[:, None], 255, 1) * np.ones(3, np.uint8)
        drawn = splat(camera, scene.points_m, marked.astype(np.uint8))[1][..., 0]
        plant = drawn == 255
        around = cv2.dilate(plant.astype(np.uint8), np.ones((15, 15), np.uint8)) > 0
        assert mask[plant].mean() > 0.9
        assert mask[(drawn == 1) & ~around].mean() < 0.01
    summary = read_summary(out)
    assert not warnings_of(summary.remarks)
    names = [row.name for row in summary.rows]
    assert names[:4] == ["points kept", "floor", "container", "outliers"]
    assert len(summary.pictures) == 5
    assert all((out / picture.file).is_file() for picture in summary.pictures)


def test_that_a_floor_was_left_out_is_known_to_those_who_would_look_for_one(result: Path, tmp_path: Path) -> None:
    def asked(out: Path) -> bool:
        return is_floorless(SimpleNamespace(has=lambda _: True, result_of=lambda _: out))  # type: ignore[arg-type]

    assert asked(run(result, tmp_path / "out"))
    assert not asked(run(result, tmp_path / "kept", floor=False))


def test_masks_that_were_drawn_are_known_from_those_that_were_given(result: Path, tmp_path: Path) -> None:
    def asked(out: Path) -> bool:
        return has_drawn_masks(SimpleNamespace(has=lambda _: True, result_of=lambda _: out))  # type: ignore[arg-type]

    assert asked(run(result, tmp_path / "out"))
    kept = run(result, tmp_path / "kept", floor=False, container=False, outliers=False)
    assert not asked(kept)
    assert not has_drawn_masks(SimpleNamespace(has=lambda _: False))  # type: ignore[arg-type]


def test_the_same_capture_gives_the_same_bytes(result: Path, tmp_path: Path) -> None:
    assert digests(run(result, tmp_path / "one")) == digests(run(result, tmp_path / "two"))


def test_masks_that_the_user_gave_hold_as_well(result: Path, tmp_path: Path) -> None:
    given = tmp_path / "given"
    copy(result, given)
    half = np.zeros(SIZE[::-1], np.uint8)
    half[:, : SIZE[0] // 2] = 255
    folder = given / "capture" / "fern" / "masks"
    folder.mkdir()
    for number in range(VIEWS):
        cv2.imwrite(str(folder / f"{number}.png"), half)
    masks = [view.mask for view in read_views(read_capture(run(given, tmp_path / "out") / "capture" / "fern")).views]
    for mask in masks:
        assert mask is not None
        assert mask[:, : SIZE[0] // 2].any()
        assert not mask[:, SIZE[0] // 2 :].any()


def test_masks_of_large_photographs_are_drawn_smaller_and_look_the_same(
    result: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from usdfoliage.jobs.plant.stages import isolate

    whole = read_views(read_capture(run(result, tmp_path / "whole") / "capture" / "fern")).views
    drawn: list[tuple[int, ...]] = []
    at_once: list[int] = []
    true_draw, true_map = isolate.draw_plant_mask, isolate.map_ahead

    def draw(srgb: np.ndarray, points_m: np.ndarray, *given: Any) -> np.ndarray:
        drawn.append(srgb.shape)
        assert points_m.shape == srgb.shape
        return true_draw(srgb, points_m, *given)

    def map_here(function: Any, items: Any, threads: int) -> Any:
        at_once.append(threads)
        return true_map(function, items, threads)

    monkeypatch.setattr(isolate, "draw_plant_mask", draw)
    monkeypatch.setattr(isolate, "map_ahead", map_here)
    monkeypatch.setattr(isolate, "_LONGEST_PX", SIZE[0] // 2)
    monkeypatch.setattr(isolate, "_PIXELS_AT_ONCE", SIZE[0] * SIZE[1])
    small = read_views(read_capture(run(result, tmp_path / "small") / "capture" / "fern")).views
    assert set(drawn) == {(SIZE[1] // 2, SIZE[0] // 2, 3)}
    assert at_once == [1]
    for first, second in zip(whole, small, strict=True):
        assert first.mask is not None
        assert second.mask is not None
        assert second.mask.shape == SIZE[::-1]
        assert (first.mask & second.mask).sum() / (first.mask | second.mask).sum() > 0.9


def copy(source: Path, target: Path) -> None:
    for path in source.rglob("*"):
        if path.is_file():
            there = target / path.relative_to(source)
            there.parent.mkdir(parents=True, exist_ok=True)
            there.write_bytes(path.read_bytes())


def test_where_nothing_is_left_out_everything_stays_as_it_was(result: Path, tmp_path: Path) -> None:
    out = run(result, tmp_path / "out", floor=False, container=False, outliers=False)
    capture = out / "capture" / "fern"
    assert not (capture / "masks").exists()
    assert (capture / "cloud.ply").read_bytes() == (result / "capture" / "fern" / "cloud.ply").read_bytes()
    assert "isolation-masks-unchanged" in [each.code for each in read_summary(out).remarks]


def test_where_hardly_anything_is_left_everything_is_taken_and_that_is_a_warning(
    result: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from usdfoliage.jobs.plant.stages import isolate

    true = isolate.isolate_plant

    def nothing(*given: Any) -> Any:
        found = true(*given)
        return replace(found, kind=np.full_like(found.kind, PointKind.FLOOR))

    monkeypatch.setattr(isolate, "isolate_plant", nothing)
    out = run(result, tmp_path / "out")
    assert [each.code for each in warnings_of(read_summary(out).remarks)] == ["isolation-nothing-left"]
    assert len(read_cloud(out / "capture" / "fern" / "cloud.ply")) == len(potted_plant().points_m)


@pytest.mark.parametrize("link_gap", [0.0, 0.029, 1.1])
def test_gaps_that_cannot_be_are_refused(link_gap: float) -> None:
    with pytest.raises(ValueError, match=r"link_gap must be 0\.03 to 1, not"):
        IsolationStageSettings(link_gap=link_gap)


def test_a_capture_that_cannot_be_read_does_not_end_the_build(result: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    copy(result, broken)
    (broken / "capture" / "fern" / "cloud.ply").write_bytes(b"ply\nno cloud")
    out = run(broken, tmp_path / "out")
    (failed,) = warnings_of(read_summary(out).remarks)
    assert failed.code == "isolation-failed"
    assert "; " not in failed.text
    assert len(read_capture(out / "capture" / "fern").views) == VIEWS


def test_the_depth_that_was_given_lies_beside_that_which_was_found(result: Path, tmp_path: Path) -> None:
    out = run(result, tmp_path / "out", given_depth=result / "capture" / "fern")
    assert len(list((out / "capture" / "fern" / GIVEN_DEPTH).glob("*.exr"))) == VIEWS
    assert all(view.depth for view in read_capture(out / "capture" / "fern", depth=GIVEN_DEPTH).views)
