"""A capture from photographs on the command line: good input, bad input, runs that are stopped and go on."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest
from scipy.spatial.transform import Rotation
from usdfoliage.capture.cloud_files.ply import read_cloud
from usdfoliage.capture.folder.map_files import read_confidence_map, read_normal_map
from usdfoliage.capture.folder.read import read_capture, read_views
from usdfoliage.capture.mvs.view_depths import widen_mask
from usdfoliage.capture.poses.result import Registered, RegisteredPhoto, Unregistered
from usdfoliage.capture.poses.world_frame import level_and_scale
from usdfoliage.cli import capture as command
from usdfoliage.errors import CaptureError
from usdfoliage.jobs.capture import poses as capture_poses
from usdfoliage.jobs.capture.settings import QUALITIES
from usdfoliage.remark_codes import REMARK_KINDS
from usdfoliage.remarks import remark, remark_from_json

from tests.capture.mvs.test_colmap_stereo import write_matrix
from tests.support.capture_photos import LENS, draw, poses, scene, write_photos, write_posed_photos
from tests.support.captures import write_depth, write_text_model
from tests.support.commands.json_output import read_output
from tests.support.leaves.commands import files, printed, refused, run

WORK = Path(".usdfoliage") / "capture"
RESULTS = {"depth", "normals", "confidence", "cloud.ply", "capture.usda", "capture_cloud.usdc"}


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    """A capture that nobody writes to."""
    folder = tmp_path_factory.mktemp("photographs of today") / "bed 1"
    write_posed_photos(folder)
    return folder


@pytest.fixture(scope="module")
def made(photos, tmp_path_factory):
    """What a run that nothing disturbs makes of it."""
    folder = tmp_path_factory.mktemp("undisturbed") / "bed 1"
    shutil.copytree(photos, folder)
    assert run(*words(folder)) == 0
    return folder


@pytest.fixture
def bed(photos, tmp_path):
    """A copy to work on."""
    shutil.copytree(photos, tmp_path / "bed 1")
    return tmp_path / "bed 1"


def words(folder, *more):
    return ("capture", folder, "--settings", folder / "fast.toml", "--no-report", *more)


def results(folder):
    """All that a run writes, but its report and what it keeps for itself."""
    return {
        name: data
        for name, data in files(folder).items()
        if not name.startswith((".usdfoliage", "report", "images", "cameras", "masks"))
    }


def true_depths():
    """By name, and where a leaf is seen."""
    drawn = {name: draw(scene(), LENS.pinhole(pose)) for name, pose in poses().items()}
    return {name: (depth, leaf_id > 0) for name, (_, depth, leaf_id) in drawn.items()}


def test_depth_and_cloud_are_those_of_the_scene(made):
    capture = read_capture(made)
    read = read_views(capture)  # as the leaves are looked for in it
    assert [view.depth.name for view in capture.views] == [f"leaf {k}.exr" for k in range(5)]
    assert capture.remarks == read.remarks == ()
    for view, (true, leaf) in zip(read.views, true_depths().values(), strict=True):
        there = view.depth_m > 0
        assert np.mean(there[leaf]) > 0.85
        assert np.mean(np.abs(view.depth_m - true)[there] < 0.02 * true[there]) > 0.95
        normals = read_normal_map(made / "normals" / f"{Path(view.name).stem}.exr")
        confidence = read_confidence_map(made / "confidence" / f"{Path(view.name).stem}.exr")
        assert (np.linalg.norm(normals, axis=2) > 0.5).tolist() == there.tolist()
        assert (confidence[there] > 0).mean() > 0.9
        assert not confidence[~there].any()
        ground = there & ~leaf
        assert np.median(normals[ground] @ [0, 0, 1]) > 0.98

    cloud = read_cloud(made / "cloud.ply")
    ground = np.abs(cloud.points_m[:, 2]) < 0.02
    assert np.mean(ground) > 0.3
    assert np.median(cloud.normals[ground, 2]) > 0.98
    assert np.mean(cloud.points_m[:, 2] > 0.6) < 0.01
    assert cloud.views.max() > 2
    greener = cloud.srgb[:, 1].astype(int) - cloud.srgb[:, 0]
    assert np.median(greener[cloud.points_m[:, 2] > 0.1]) > 40 > 0 > np.median(greener[ground])


def test_nothing_of_the_input_changes(photos, made):
    before, after = files(photos), files(made)
    assert {name: after[name] for name in before if name != "capture.toml"} == {
        name: data for name, data in before.items() if name != "capture.toml"
    }
    assert {path.name for path in made.iterdir()} >= RESULTS
    text = (made / "capture.toml").read_text()
    assert text.endswith('up_axis = "Z"\n')
    assert "metres_per_unit = 1.0\n" in text


def test_every_number_of_threads_gives_the_same_bytes(bed, made):
    assert run(*words(bed, "--threads", 1)) == 0
    assert results(bed) == results(made)


def test_a_second_run_takes_all_from_the_first(bed, made, capsys):
    printed(capsys, *words(bed))
    lines = printed(capsys, *words(bed, "--resume"))
    assert "note: 15 of 15 tasks of depth were done by an earlier run" in lines
    assert results(bed) == results(made)
    assert "earlier run" not in "".join(printed(capsys, *words(bed, "--fresh")))
    assert results(bed) == results(made)
    assert "there is no" not in refused(capsys, *words(bed, "--fresh", "--resume"))


def test_a_capture_is_one_json_object(bed, capsys):
    made = read_output("capture", "\n".join(printed(capsys, *words(bed, "--json"))))
    assert made["asset"] is None
    assert made["report"] is None  # --no-report
    assert Path(made["cloud"]) == bed / "cloud.ply"
    assert [fact["name"] for fact in made["facts"]] == ["photographs", "coverage", "points"]
    assert all(seconds >= 0 for seconds in made["seconds"].values())
    assert {remark_from_json(each).code for each in made["remarks"]} <= set(REMARK_KINDS)
    again = json.loads("\n".join(printed(capsys, *words(bed, "--json"))))
    assert "tasks-done-before" in [each["code"] for each in again["remarks"]]


def test_the_summary_and_the_report(bed, capsys):
    lines = printed(capsys, "capture", bed, "--settings", bed / "fast.toml", "--report-views", 2)
    assert "photographs: 5 of 5 have a pose, 5 have depth" in lines
    cloud = read_cloud(bed / "cloud.ply")
    assert f"points: {len(cloud):,}" in lines
    assert f"cloud: {bed / 'cloud.ply'}" in lines
    assert any(line.startswith("coverage: ") for line in lines)
    assert not [line for line in lines if line.startswith("note: ")]
    assert f"report: {bed / 'report' / 'index.html'}" in lines
    page = (bed / "report" / "index.html").read_text()
    assert all(name in page for name in poses())
    assert str(bed.parent) not in page
    assert len(list((bed / "report").glob("view_*_depth.jpg"))) == 2


KILLED = """
import os, signal, sys
from usdfoliage.jobs.capture import {module}
real, left = {module}.{function}, [{after}]
def {function}(*words, **named):
    left[0] -= 1
    if left[0] < 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return real(*words, **named)
{module}.{function} = {function}
from usdfoliage.__main__ import main
main(sys.argv[1:])
"""


@pytest.mark.parametrize(
    ("module", "function", "after", "found"),
    [
        ("depth_tasks", "match_round", 7, 7),
        ("maps", "write_normal_map", 1, 15),
        ("folder", "digest_file", 3, 15),
    ],
)
def test_a_killed_run_goes_on_where_it_was(bed, made, capsys, module, function, after, found):
    alone = map(str, words(bed, "--threads", 1))  # what is worked on beside the one that is killed would be lost too
    script = KILLED.format(module=module, function=function, after=after)
    killed = subprocess.run([sys.executable, "-c", script, *alone], check=False, capture_output=True)
    assert killed.returncode == -signal.SIGKILL, killed.stderr.decode()
    assert not (bed / "cloud.ply").exists()
    notes = [line for line in printed(capsys, *words(bed)) if line.startswith("note: ")]
    assert notes == [f"note: {found} of 15 tasks of depth were done by an earlier run"]
    assert results(bed) == results(made)
    assert {path.parent.name for path in (bed / WORK / "planes").rglob("*.npz")} == {"1"}  # of the last round


def test_what_is_believed_may_change_without_matching_again(bed, made, capsys):
    assert run(*words(bed)) == 0
    settings = (bed / "fast.toml").read_text()
    (bed / "fast.toml").write_text(settings + "\n[depth.agreement]\nmax_cost = 1.2\n")
    assert "note: 10 of 15 tasks of depth were done by an earlier run" in printed(capsys, *words(bed))
    assert results(bed) != results(made)


def test_damaged_results_are_made_again(bed, made, capsys):
    assert run(*words(bed)) == 0
    for kind, damage in (("photos", b""), ("depth", b"PK"), ("maps", b"\0" * 100)):
        damaged = sorted(path for path in (bed / WORK / kind).rglob("*.*z") if path.suffix != ".json")
        damaged += sorted((bed / WORK / kind).rglob("depth.exr"))
        os.truncate(damaged[0], damaged[0].stat().st_size // 2)
        damaged[1].write_bytes(damage)
    (bed / WORK / "written.json").write_text("{")
    assert run(*words(bed, "--force")) == 0
    assert results(bed) == results(made)


def test_only_chosen_photographs_are_used(bed, made):
    assert run(*words(bed, "--views", "0:3")) == 0
    assert sorted(path.stem for path in (bed / "depth").iterdir()) == ["leaf 0", "leaf 1", "leaf 2"]
    assert run(*words(bed)) == 0
    assert results(bed) == results(made)
    assert run(*words(bed, "--views", "0:3")) == 0
    assert len(list((bed / WORK / "depth").rglob("*.npz"))) == 8  # those of all five as well


def test_a_folder_of_photographs_needs_a_place(photos, tmp_path, capsys):
    message = refused(capsys, "capture", photos / "images")
    assert "-o" in message
    assert "images_capture" in message
    assert "another folder" in refused(capsys, "capture", photos / "images", "-o", photos / "images")


def test_photographs_are_linked_into_another_capture(photos, made, tmp_path):
    out = tmp_path / "here" / ".." / "beds of today" / "bed 1"
    (tmp_path / "here").mkdir()
    assert run("capture", photos, "-o", out, "--settings", photos / "fast.toml", "--no-report") == 0
    ours = results(out)
    theirs = results(made)
    theirs.pop("fast.toml")
    assert ours == theirs
    for name in poses():
        assert (out / "images" / name).samefile(photos / "images" / name)
        assert not (out / "images" / name).is_symlink()
    assert files(out / "cameras") == files(photos / "cameras")
    assert "metres_per_unit" not in (photos / "capture.toml").read_text()


def test_other_photographs_in_the_output_folder_are_not_lost(photos, tmp_path, capsys):
    out = tmp_path / "out"
    write_photos(out / "images", {"mine.png": next(iter(poses().values()))})
    assert "mine.png" in refused(
        capsys, "capture", photos, "-o", out, "--settings", photos / "fast.toml", "--no-report"
    )
    assert [path.name for path in (out / "images").iterdir()] == ["mine.png"]
    assert run("capture", photos, "-o", out, "--settings", photos / "fast.toml", "--no-report", "--force") == 0
    assert "mine.png" not in files(out / "images")


def test_photographs_that_went_are_taken_out_again(photos, tmp_path):
    source = tmp_path / "source"
    shutil.copytree(photos, source)
    out = tmp_path / "out"
    assert run("capture", source, "-o", out, "--settings", photos / "fast.toml", "--no-report") == 0
    (source / "images" / "leaf 4.png").unlink()
    assert run("capture", source, "-o", out, "--settings", photos / "fast.toml", "--no-report") == 0
    assert len(files(out / "images")) == len(files(out / "depth")) == 4


def test_unreadable_photographs_are_skipped_and_named(bed, capsys):
    photo = bed / "images" / "leaf 2.png"
    os.truncate(photo, photo.stat().st_size // 2)
    (bed / "images" / "leaf 4.png").write_bytes(b"no picture")
    lines = printed(capsys, *words(bed))
    left_out = [line for line in lines if "is left out" in line]
    assert len(left_out) == 2
    assert "leaf 2.png" in left_out[0]
    assert "leaf 4.png" in left_out[1]
    assert "photographs: 5 of 5 have a pose, 3 have depth" in lines
    assert sorted(path.stem for path in (bed / "depth").iterdir()) == ["leaf 0", "leaf 1", "leaf 3"]
    assert len(read_views(read_capture(bed)).views) == 3


def test_depth_is_only_where_the_masks_are_white_and_just_around(bed, capsys):
    leaf_masks = {name: leaf for name, (_, leaf) in true_depths().items()}
    (bed / "masks").mkdir()
    for name, leaf in leaf_masks.items():
        assert cv2.imwrite(str(bed / "masks" / name), leaf.astype(np.uint8) * 255)
    printed(capsys, *words(bed))
    for view, leaf in zip(read_views(read_capture(bed)).views, leaf_masks.values(), strict=True):
        assert not (view.depth_m[~widen_mask(leaf)] > 0).any()
        assert np.mean(view.depth_m[leaf] > 0) > 0.6
    cloud = read_cloud(bed / "cloud.ply")
    assert np.mean(np.abs(cloud.points_m[:, 2]) < 0.02) < 0.05  # next to nothing of the ground around the leaves
    printed(capsys, *words(bed, "--mask", "none"))
    assert all(np.mean(view.depth_m > 0) > 0.35 for view in read_views(read_capture(bed)).views)


def test_cameras_of_one_photograph_are_refused_by_the_name_of_the_input(bed, tmp_path, capsys):
    path = bed / "cameras" / "images.txt"
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    path.write_text("\n".join(lines[:2]) + "\n")
    complaint = refused(capsys, *words(bed), "-o", tmp_path / "made")
    assert f"1 photograph of 1 with a camera in {bed} can be used, and depth takes two at least" in complaint


def test_depth_of_the_user_is_kept(bed, made, capsys):
    for name in poses():
        write_depth((bed / "depth" / name).with_suffix(".exr"), np.ones((LENS.height_px, LENS.width_px)))
    given = files(bed / "depth")
    for _ in range(2):
        lines = printed(capsys, *words(bed))
        assert files(bed / "depth") == given
        assert files(bed / "depth_estimated") == files(made / "depth")
        assert any("depth was there and is kept" in line for line in lines)
    printed(capsys, *words(bed, "--force"))
    assert files(bed / "depth") == files(made / "depth")


def test_what_the_user_made_since_is_not_replaced(bed, capsys):
    printed(capsys, *words(bed))
    (bed / "cloud.ply").write_bytes((bed / "cloud.ply").read_bytes() + b"\n")
    assert "cloud.ply" in refused(capsys, *words(bed, "--seed", 1))
    assert "cloud.ply" in refused(capsys, *words(bed, "--seed", 1, "--dry-run"))
    assert run(*words(bed, "--seed", 1, "--force")) == 0


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_capture_toml_keeps_what_the_user_wrote(bed, capsys, end):
    written = end.join(["\ufeff# The hedge", 'name = "Hécke"  # ours', "", "[scanner]", "up_axis = 3", ""])
    (bed / "capture.toml").write_bytes(written.encode())
    printed(capsys, *words(bed))
    text = (bed / "capture.toml").read_bytes().decode()
    assert text.endswith(written[1:])
    assert text.count("\r\n") == text.count("\n") * (end == "\r\n")
    capture = read_capture(bed)
    assert (capture.settings.name, capture.settings.up_axis) == ("Hécke", "Y")
    once = (bed / "capture.toml").read_bytes()
    printed(capsys, *words(bed))
    assert (bed / "capture.toml").read_bytes() == once


def test_the_unit_of_the_poses_is_kept(bed, made):
    write_text_model(
        bed / "cameras", {n: np.column_stack([p[:, :3], p[:, 3] * 100]) for n, p in poses().items()}, [LENS]
    )
    (bed / "capture.toml").write_text('up_axis = "Z"\nmetres_per_unit = 0.01\n')
    assert run(*words(bed)) == 0
    cloud, metric = read_cloud(bed / "cloud.ply"), read_cloud(made / "cloud.ply")
    assert np.ptp(cloud.points_m, axis=0) == pytest.approx(100 * np.ptp(metric.points_m, axis=0), rel=0.1)
    for view in read_views(read_capture(bed)).views:
        assert 1 < np.median(view.depth_m[view.depth_m > 0]) < 4


@pytest.mark.parametrize(
    ("text", "reason"),
    [("up_axis = 3", "up_axis"), ("metres_per_unit = -1", "metres_per_unit"), ("up_axis =", "TOML")],
)
def test_wrong_facts_of_a_capture_are_refused_before_anything_is_written(bed, capsys, text, reason):
    (bed / "capture.toml").write_text(text)
    before = files(bed)
    message = refused(capsys, *words(bed))
    assert reason in message
    assert "capture.toml" in message
    assert files(bed) == before


def test_no_photographs_one_photograph_and_videos(tmp_path, capsys):
    folder = tmp_path / "photos"
    out = ("-o", tmp_path / "out")
    assert "does not exist" in refused(capsys, "capture", folder, *out)
    folder.mkdir()
    assert "no photographs" in refused(capsys, "capture", folder, *out)
    (folder / "walk.mp4").write_bytes(b"video")
    assert f"give the video itself, {folder / 'walk.mp4'}" in refused(capsys, "capture", folder, *out)
    assert "walk.mp4 is not a video that can be read" in refused(capsys, "capture", folder / "walk.mp4", *out)
    (folder / "walk.mp4").unlink()
    write_photos(folder / "deeper", {"one.png": poses()["leaf 0.png"]})
    assert "deeper" in refused(capsys, "capture", folder, *out)
    write_photos(folder, {"one.png": poses()["leaf 0.png"]})
    assert "one photograph" in refused(capsys, "capture", folder, *out)
    assert "one file" in refused(capsys, "capture", folder / "one.png", *out)
    assert "no photographs are named" in refused(capsys, "capture")
    assert not (tmp_path / "out").exists()


def test_files_that_are_not_used_are_named(photos, tmp_path, capsys):
    folder = tmp_path / "mixed"
    shutil.copytree(photos / "images", folder)
    (folder / "walk.mp4").write_bytes(b"x")
    (folder / "leaf 0.heic").write_bytes(b"x")  # beside a PNG of that name
    (folder / "list.txt").write_bytes(b"x")
    shutil.copytree(photos / "images", folder / "second")
    text = "\n".join(printed(capsys, "capture", folder, "-o", tmp_path / "out", "--dry-run"))
    assert "walk.mp4 not used, as there are photographs: to use it instead, give the video itself, walk.mp4" in text
    assert "leaf 0.heic not used, as there are photographs of the same name" in text
    assert "list.txt not used: no photographs" in text
    assert "photographs in folders below (second) not used" in text


def test_photographs_of_different_places_are_refused(bed, capsys):
    apart = poses()
    for number, pose in enumerate(apart.values()):
        pose[:, 3] += pose[:, :3] @ [100.0 * number, 0, 0]
    write_text_model(bed / "cameras", apart, [LENS])
    assert "same place" in refused(capsys, *words(bed))


def test_a_run_in_a_folder_that_another_run_uses_is_refused(bed, capsys):
    from usdfoliage.jobs.work.results import lock_work

    with lock_work(bed / WORK):
        message = refused(capsys, *words(bed))
    assert f"process {os.getpid()}" in message
    assert run(*words(bed)) == 0


def test_a_full_disk_loses_nothing(photos, made, small_disk, capsys):
    out = small_disk / "bed 1"
    subprocess.run(["mount", "-o", "remount,size=800k", str(small_disk)], check=True)
    call = ("capture", photos, "-o", out, "--settings", photos / "fast.toml", "--no-report")
    message = refused(capsys, *call)
    assert "No space left" in message
    assert "MB are free" in message
    assert not (out / "cloud.ply").exists()
    assert not list(out.rglob("*usdfoliage-new*")) + list(out.rglob("*.new"))
    subprocess.run(["mount", "-o", "remount,size=20m", str(small_disk)], check=True)
    lines = printed(capsys, *call)
    assert any("were done by an earlier run" in line for line in lines)
    assert (out / "cloud.ply").read_bytes() == (made / "cloud.ply").read_bytes()


def test_a_dry_run_prints_the_plan_and_writes_nothing(bed, capsys):
    before = files(bed)
    lines = printed(capsys, *words(bed, "--dry-run"))
    assert files(bed) == before
    text = "\n".join(lines)
    assert "5 of 128 x 96 px" in text
    assert "poses: known, of 5 photographs" in text
    assert "tasks: 15, 0 of them done by an earlier run" in text
    assert "cloud.ply" in text
    printed(capsys, *words(bed))
    assert "tasks: 15, 15 of them done" in "\n".join(printed(capsys, *words(bed, "--dry-run")))


def test_settings_of_every_quality_can_be_given_back(tmp_path, capsys):
    assert command.QUALITIES == QUALITIES
    for quality in QUALITIES:
        lines = printed(capsys, "capture", "--print-settings", "--quality", quality)
        (tmp_path / "all.toml").write_text("\n".join(lines))
        assert printed(capsys, "capture", "--print-settings", "--settings", tmp_path / "all.toml") == lines


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("rounds = []", "rounds"),
        ("rounds = [{ level = 1 }]", "coherent"),
        ("rounds = [{ level = 1, iterations = 2.5, coherent = true }]", "whole number"),
    ],
)
def test_impossible_rounds_are_refused(bed, capsys, line, message):
    (bed / "fast.toml").write_text(f"[depth]\n{line}\n")
    assert message in refused(capsys, *words(bed))


def test_an_interrupted_run_reports_that_it_can_go_on(bed, capsys, monkeypatch):
    from usdfoliage.jobs.capture import run as capture

    def interrupt(*_words, **_named):
        raise KeyboardInterrupt

    monkeypatch.setattr(capture, "write_maps", interrupt)
    assert run(*words(bed)) == 130
    assert "goes on from here" in capsys.readouterr().err
    assert not (bed / "cloud.ply").exists()


def test_resume_alone_begins_nothing(bed, capsys):
    assert "no earlier run" in refused(capsys, *words(bed, "--resume"))
    assert not (bed / ".usdfoliage").exists()
    assert "99" in refused(capsys, *words(bed, "--views", "99"))
    assert "no earlier run" in refused(capsys, *words(bed, "--resume"))  # what failed left nothing to go on with


def test_colmap_in_the_place_of_our_matching(bed, capsys, monkeypatch):
    monkeypatch.setattr(pycolmap, "has_cuda", False)
    assert "without CUDA" in refused(capsys, *words(bed, "--dense", "colmap"))
    assert not (bed / ".usdfoliage").exists()

    def match(folder, options):
        """What is true."""
        assert options.depth_min > 0
        for index, pose in enumerate(poses().values()):
            camera = LENS.pinhole(pose)
            _, depth_m, _ = draw(scene(), camera)
            normals = np.broadcast_to(camera.cam_from_world[:, :3] @ [0, 0, 1.0], (*depth_m.shape, 3))
            for kind, values in (("depth", depth_m[..., None]), ("normal", normals)):
                path = Path(folder) / "stereo" / f"{kind}_maps" / f"{index:06d}.png.geometric.bin"
                write_matrix(path, values)

    monkeypatch.setattr(pycolmap, "has_cuda", True)
    monkeypatch.setattr(pycolmap, "patch_match_stereo", match)
    printed(capsys, *words(bed, "--dense", "colmap"))
    for view, (true, _) in zip(read_views(read_capture(bed)).views, true_depths().values(), strict=True):
        there = view.depth_m > 0
        assert there.mean() > 0.4
        np.testing.assert_allclose(view.depth_m[there], true[there], rtol=0.02)
    assert not (bed / WORK / "colmap" / "images").exists()


LEANED = Rotation.from_euler("xyz", [0.4, -1.1, 2.0]).as_matrix()


def up_option(registered, stated=((1, 0, 0), (0, 1, 0), (0, 0, 1))):
    """Up as the user sees it in a capture made without: the cameras look straight down, of which nothing else knows."""
    without = level_and_scale(registered, ()).world_from_registered[:3, :3]
    return "--up=" + ",".join(str(number) for number in stated @ without @ LEANED @ (0, 0, 1))


@pytest.fixture
def registered(monkeypatch):
    """Registration that knows the poses, in a world turned, moved and five times as large; but not of the last one."""
    moved = np.array([3.0, -2.0, 7.0])
    photos = []
    for name, pose in list(poses().items())[:-1]:
        rotation = pose[:, :3] @ LEANED.T
        photos.append(
            RegisteredPhoto(
                name=name,
                lens=LENS,
                cam_from_world=np.column_stack([rotation, 5 * pose[:, 3] - rotation @ moved]),
                error_px=0.5,
                points=0,
            )
        )
    ground = np.stack(np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9), [0.0, 0.3]), -1).reshape(-1, 3)
    cameras = [LENS.pinhole(pose) for pose in list(poses().values())[:-1]]
    places = [camera.project(ground)[0] for camera in cameras]
    found = Registered(
        photos=tuple(photos),
        points=5 * ground @ LEANED.T + moved,
        srgb=np.full((len(ground), 3), 90, np.uint8),
        error_px=np.full(len(ground), 0.5),
        track_starts=np.arange(len(ground) + 1) * len(cameras),
        track_photos=np.tile(np.arange(len(cameras)), len(ground)),
        track_places_px=np.stack(places, 1).reshape(-1, 2),
        names=tuple(poses()),
        matches=np.full((5, 5), 40, np.int64),
        failures=(Unregistered(name="leaf 4.png", reason="it shows another place"),),
        remarks=(remark("photographs-not-registered", "1 of 5 photographs have no camera: leaf 4.png"),),
    )
    monkeypatch.setattr(capture_poses, "register_photos", lambda *_words, **_named: found)
    return found


def test_poses_are_estimated_where_there_are_none(photos, made, registered, tmp_path, capsys):
    out = tmp_path / "out"
    names = ",".join(list(poses())[0:4:3])
    places = [LENS.pinhole(poses()[f"leaf {k}.png"]).position_m for k in (0, 3)]
    apart = np.linalg.norm(places[0] - places[1])
    hints = ("--settings", photos / "fast.toml", up_option(registered), "--scale", f"{names},{apart}")
    call = ("capture", photos / "images", "-o", out, *hints)
    lines = printed(capsys, *call)
    assert "photographs: 4 of 5 have a pose, 4 have depth" in lines
    assert any("scale by distance" in line for line in lines)
    capture = read_capture(out)
    assert (capture.settings.up_axis, capture.settings.metres_per_unit) == ("Y", 1.0)
    cloud, known = read_cloud(out / "cloud.ply"), read_cloud(made / "cloud.ply")
    flat = np.percentile(cloud.points_m[:, 1], [10, 50]) - np.percentile(known.points_m[:, 2], [10, 50])
    assert np.ptp(flat) < 0.03  # in metres, and upright
    first, last = (LENS.pinhole(capture.views[k].cam_from_world).position_m for k in (0, 3))
    assert np.linalg.norm(first - last) == pytest.approx(apart)
    assert "it shows another place" in (out / "report" / "index.html").read_text()

    once = results(out)
    assert any("earlier run" in line for line in printed(capsys, *call))
    in_place = ("capture", out, *hints)
    assert any("poses are estimated" in line for line in printed(capsys, *in_place))
    assert results(out) == once
    printed(capsys, "capture", out, "--settings", photos / "fast.toml", "--poses", "known", "--no-report")
    assert any("15 of" in line or "12 of 12" in line for line in printed(capsys, *in_place))


def test_files_that_cannot_be_read_are_named_where_no_cameras_are_found(photos, tmp_path, capsys, monkeypatch):
    def find_none(*_words, **_named):
        raise CaptureError("no cameras could be found")

    monkeypatch.setattr(capture_poses, "register_photos", find_none)
    shutil.copytree(photos / "images", tmp_path / "photos")
    (tmp_path / "photos" / "torn.jpg").write_bytes(b"\xff\xd8\xff torn")
    complaint = refused(capsys, "capture", tmp_path / "photos", "-o", tmp_path / "out")
    assert "no cameras could be found (torn.jpg is left out: " in complaint


def test_estimated_poses_take_the_axes_and_unit_that_are_stated(photos, registered, tmp_path):
    source = tmp_path / "source"
    shutil.copytree(photos / "images", source / "images")
    (source / "capture.toml").write_text(
        'up_axis = "Z"\nmetres_per_unit = 0.01\n\n[known_distance]\nphotographs = ["leaf 0.png", "leaf 3.png"]\n'
        "metres = 1.5\n"
    )
    up = up_option(registered, stated=np.array([(1, 0, 0), (0, 0, -1), (0, 1, 0)]))
    assert run("capture", source, "--settings", photos / "fast.toml", up) == 0
    cloud = read_cloud(source / "cloud.ply")
    assert np.ptp(np.percentile(cloud.points_m, [5, 95], axis=0), axis=0).argmin() == 2
    assert np.median(np.abs(cloud.normals[:, 2])) > 0.9
    positions = [LENS.pinhole(view.cam_from_world).position_m for view in read_capture(source).views]
    assert np.linalg.norm(positions[0] - positions[3]) == pytest.approx(1.5)
    assert np.median(cloud.points_m, axis=0)[2] < positions[0][2] * 100


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (("--poses", "estimate"), "never replaced"),
        (("--scale", "2"), "keep their frame"),
        (("--up", "trunk"), "keep their frame"),
        (("--scale", "a.jpg,2"), "PHOTO,PHOTO,METRES"),
        (("--scale", "0"), "the scale must be in"),
        (("--scale", "a.jpg,b.jpg,-2"), "above 0"),
        (("--up", "north"), "X,Y,Z"),
    ],
)
def test_poses_that_are_given_are_kept(bed, capsys, more, message):
    assert message in refused(capsys, *words(bed, *more))
    assert not (bed / ".usdfoliage").exists()


def test_poses_that_are_not_there_or_damaged(photos, bed, tmp_path, capsys):
    out = tmp_path / "out"
    assert "known poses" in refused(capsys, "capture", photos / "images", "-o", out, "--poses", "known")
    for name in ("cameras.txt", "images.txt"):
        (bed / "cameras" / name).unlink()
    assert "COLMAP" in refused(capsys, *words(bed))
    assert not (bed / ".usdfoliage").exists()
    assert not out.exists()


def test_a_dry_run_prints_that_poses_are_estimated(photos, tmp_path, capsys):
    lines = printed(capsys, "capture", photos / "images", "-o", tmp_path / "out", "--dry-run")
    assert "poses: to be estimated" in lines
    assert "cameras/" in lines[-1]
    assert not (tmp_path / "out").exists()
