"""The window of a photograph on a virtual display: strokes by the mouse, and what comes of them."""

import json

import cv2
import numpy as np
import pytest
from usdfoliage.__main__ import main
from usdfoliage.errors import FoliageError, PreviewError
from usdfoliage.jobs.preview.viewer import ViewerSettings
from usdfoliage.jobs.sketch.window import draw_over_photo
from usdfoliage.sketch.strokes import read_strokes

from tests.support.photographs.drawn_trees import draw_leafy

pytestmark = pytest.mark.preview
SIZE = {"width_px": 900, "height_px": 560}


def write_photo(folder):
    tree = draw_leafy()
    photo = folder / "oak tree.png"
    cv2.imwrite(str(photo), tree.srgb[..., ::-1])
    return photo, tree.strokes


def play(photo, actions) -> None:
    script = photo.parent / "script.json"
    script.write_text(json.dumps(actions), encoding="utf-8")
    draw_over_photo(photo, ViewerSettings(script=script, **SIZE))


def crown(strokes, grow=1.0) -> dict:
    points = np.asarray(strokes.crown_px)
    middle = points.mean(axis=0)
    return {"stroke": {"button": "left", "points": (middle + grow * (points - middle)).tolist()}}


def branch(points) -> dict:
    return {"stroke": {"button": "right", "points": np.asarray(points, float).tolist()}}


@pytest.fixture(scope="module")
def session(display, tmp_path_factory):
    """One window in which a tree is drawn, grown and saved; its folder, and its pictures by name."""
    folder = tmp_path_factory.mktemp("a drawing")
    photo, strokes = write_photo(folder)

    def picture(name) -> dict:
        return {"window": str(folder / f"{name}.png")}

    trunk = strokes.branches_px[0]
    wrong = [[40, 60], [80, 90], [120, 100]]
    play(
        photo,
        [
            picture("start"),
            crown(strokes, 1.02),
            picture("crown"),
            branch(trunk),
            picture("trunk"),
            {"message": "traced in"},
            branch(wrong),
            picture("wrong"),
            *[{"key": "Ctrl+Z"}, picture("undone"), {"key": "Ctrl+Shift+Z"}, picture("redone")],
            *[{"click": [80, 90]}, picture("chosen"), {"key": "Del"}, {"hover": [10, 390]}, picture("deleted")],
            *[{"slide": {"leaf_length_m": 400}}, {"value": {"leaf_length_m": 0}}],  # and back to auto
            {"save_strokes": str(folder / "auto.json")},
            *[{"slide": {"gravity": 800}}, {"value": {"density": 0.4, "leaf_length_m": 0.12, "seed": 3}}],
            *[{"turning": False}, {"grow": str(folder / "growing.png")}, picture("grown")],
            *[{"turning": True}, {"turn": 3}, {"turning": False}, picture("turned")],
            *[{"key": "Ctrl+S"}, {"message": "strokes: "}],
            {"make": {"path": str(folder / "window" / "oak"), "preview": False}},
            {"save_strokes": str(folder / "copy.json")},
        ],
    )
    return folder, photo, {path.stem: cv2.imread(str(path)) for path in folder.glob("*.png")}


def differ(one, two, part=np.s_[60:500, :330]) -> int:
    """Pixels of the photograph's side of the window that are others."""
    return int((np.abs(one[part].astype(int) - two[part].astype(int)).max(axis=-1) > 12).sum())


def test_strokes_appear_with_what_was_traced(session):
    _, _, pictures = session
    assert differ(pictures["start"], pictures["crown"]) > 3000  # the stroke, and the leaves inside of it
    assert differ(pictures["crown"], pictures["trunk"]) > 100
    assert differ(pictures["trunk"], pictures["wrong"]) > 100


def test_undo_redo_and_delete_show_what_there_was(session):
    _, _, pictures = session
    assert differ(pictures["undone"], pictures["trunk"]) == 0
    assert differ(pictures["redone"], pictures["wrong"]) == 0
    assert differ(pictures["chosen"], pictures["redone"]) > 50
    assert differ(pictures["deleted"], pictures["trunk"]) == 0


def test_the_tree_grows_in_steps_and_turns(session):
    _, _, pictures = session
    tree = np.s_[60:500, 370:560]
    assert differ(pictures["growing"], pictures["grown"], tree) > 500
    assert differ(pictures["grown"], pictures["turned"], tree) > 500


def test_the_saved_strokes_hold_the_strokes_and_the_sliders(session):
    folder, photo, _ = session
    strokes = read_strokes(photo.with_name("oak tree.strokes.json"))
    assert (strokes.image, strokes.width_px, strokes.height_px) == ("oak tree.png", 300, 400)
    (tree,) = strokes.trees
    assert len(tree.branches_px) == 1
    expected = draw_leafy().strokes.branches_px[0]
    np.testing.assert_allclose(tree.branches_px[0][[0, -1]], expected[[0, -1]], atol=1)  # a pixel of the screen
    chosen = strokes.choices
    assert (chosen.gravity, chosen.density, chosen.leaf_length_m, chosen.seed) == (0.6, 0.4, 0.12, 3)
    assert not read_strokes(folder / "auto.json").choices.table
    assert (folder / "copy.json").read_bytes() == photo.with_name("oak tree.strokes.json").read_bytes()


def test_the_command_makes_the_same_bytes_of_the_saved_strokes(session):
    folder, photo, _ = session
    made, again = folder / "window" / "oak", folder / "command" / "oak"
    assert main(["sketch", str(photo), "-o", str(again), "--no-preview"]) == 0
    files = {path.relative_to(made) for path in made.rglob("*") if path.is_file()}
    assert files == {path.relative_to(again) for path in again.rglob("*") if path.is_file()}
    compared = [each for each in sorted(files) if each.parts[0] != "report"]  # which has times
    assert {".usda", ".usdc", ".exr", ".json"} <= {each.suffix for each in compared}
    for each in compared:
        assert (made / each).read_bytes() == (again / each).read_bytes(), each


def test_strokes_beside_the_photograph_are_loaded_and_others_take_their_place(session, tmp_path):
    folder, photo, _ = session
    other = json.loads((folder / "copy.json").read_text())
    other["settings"] = {"depth": 1.5}
    (folder / "other.json").write_text(json.dumps(other))
    play(
        photo,
        [
            {"save_strokes": str(tmp_path / "as_loaded.json")},
            *[{"load_strokes": str(folder / "other.json")}, {"save_strokes": str(tmp_path / "other.json")}],
            *[{"load_strokes": str(tmp_path / "none.json")}, {"message": "the strokes"}],
            {"tree": "new"},
            branch([[250, 380], [255, 300]]),
            *[{"key": "Ctrl+S"}, {"message": "a tree has no crown yet"}],
        ],
    )
    assert (tmp_path / "as_loaded.json").read_bytes() == (folder / "copy.json").read_bytes()
    assert read_strokes(tmp_path / "other.json").choices.table == {"depth": 1.5}


def test_what_the_window_cannot_do_is_one_error(display, tmp_path):
    photo, _ = write_photo(tmp_path)
    with pytest.raises(PreviewError, match=r"the key Ctrl\+Z does nothing now"):
        play(photo, [{"key": "Ctrl+Z"}])


# Without a window


def test_a_photograph_that_is_none_is_reported(tmp_path):
    (tmp_path / "a.png").write_bytes(b"none")
    with pytest.raises(FoliageError, match=r"a\.png"):
        draw_over_photo(tmp_path / "a.png")
    with pytest.raises(FoliageError, match=r"b\.png"):
        draw_over_photo(tmp_path / "b.png")


def test_strokes_of_another_photograph_are_reported(tmp_path):
    photo, _ = write_photo(tmp_path)
    tree = {"crown": [[1, 1], [9, 1], [9, 9]], "branches": []}
    beside = photo.with_name("oak tree.strokes.json")
    beside.write_text(json.dumps({"image": "b.png", "width": 10, "height": 10, **tree}))
    with pytest.raises(FoliageError, match="are of a picture of 10 x 10 pixels"):
        draw_over_photo(photo)


def test_no_display_is_one_error(tmp_path, monkeypatch, capsys):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("USDFOLIAGE_HYDRA_PYTHON", "/bin/sh")
    photo, _ = write_photo(tmp_path)
    assert main(["view", str(photo)]) == 2
    assert "no display for a window" in capsys.readouterr().err


def test_a_capture_does_not_go_with_a_photograph(tmp_path, capsys):
    photo, _ = write_photo(tmp_path)
    assert main(["view", str(photo), "--capture", str(tmp_path)]) == 2
    assert "--capture is shown over an asset" in capsys.readouterr().err
