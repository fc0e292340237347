"""Strokes over a photograph: read, checked, and written again."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.errors import CaptureError
from usdfoliage.sketch.choices import SketchChoices
from usdfoliage.sketch.strokes import Strokes, TreeStrokes, check_strokes, format_strokes, read_strokes, write_strokes

HEAD = {"image": "a.jpg", "width": 100, "height": 80}
CROWN = [[10, 10], [50, 5], [60, 40]]
TREE = {"crown": CROWN, "branches": [[[30, 70], [30, 30]]]}


def write(tmp_path, content):
    path = tmp_path / "a.strokes.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_one_tree_or_several_are_read(tmp_path):
    one = read_strokes(write(tmp_path, {**HEAD, **TREE}))
    assert (one.image, one.width_px, one.height_px, len(one.trees)) == ("a.jpg", 100, 80, 1)
    np.testing.assert_array_equal(one.trees[0].crown_px, CROWN)
    np.testing.assert_array_equal(one.trees[0].branches_px[0], [[30, 70], [30, 30]])
    assert len(read_strokes(write(tmp_path, {**HEAD, "trees": [TREE, TREE]})).trees) == 2


POINTS = st.lists(
    st.tuples(st.integers(0, 9999), st.integers(0, 9999)).map(lambda p: [p[0] / 100, p[1] / 100]),
    min_size=3,
    max_size=8,
    unique_by=tuple,
)


@given(trees=st.lists(st.tuples(POINTS, st.lists(POINTS, max_size=3)), min_size=1, max_size=3))
@settings(max_examples=40, deadline=None)
def test_what_is_written_is_read_again(tmp_path_factory, trees):
    strokes = Strokes(
        image="ä b.jpg",
        width_px=200,
        height_px=100,
        trees=tuple(
            TreeStrokes(crown_px=np.array(crown), branches_px=tuple(map(np.array, branches)))
            for crown, branches in trees
        ),
    )
    path = tmp_path_factory.mktemp("strokes") / "x.json"
    write_strokes(path, strokes)
    assert format_strokes(read_strokes(path)) == format_strokes(strokes)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", "no JSON"),
        ("[]", "holds no strokes"),
        (HEAD, "neither trees nor a crown"),
        ({**HEAD, "trees": []}, "neither trees nor a crown"),
        ({**HEAD, "trees": [TREE] * 101}, "at most 100"),
        ({**TREE, "image": "a.jpg", "width": 100}, "height must be"),
        ({**HEAD, **TREE, "width": 0}, "width must be"),
        ({**HEAD, "crown": CROWN[:2]}, "at least 3"),
        ({**HEAD, "crown": [[1, 1]] * 5}, "has 1 point"),
        ({**HEAD, "crown": [[1, 1], [2, "a"], [3, 3]]}, "list of points"),
        ({**HEAD, "crown": [[1, 1], [2, 1e12], [3, 3]]}, "list of points"),
        ({**HEAD, "crown": CROWN, "branches": [[[1, 1]]]}, "branch 1 has 1 point"),
        ({**HEAD, "crown": CROWN, "branches": {}}, "must be a list"),
        ({**HEAD, "trees": ["a"]}, "a tree is a table"),
    ],
)
def test_what_holds_no_strokes_is_one_error(tmp_path, content, words):
    with pytest.raises(CaptureError, match=words):
        read_strokes(write(tmp_path, content))


def test_strokes_of_another_picture_are_refused(tmp_path):
    strokes = read_strokes(write(tmp_path, {**HEAD, **TREE}))
    check_strokes(strokes, 100, 80, "s")
    with pytest.raises(CaptureError, match="200 x 80"):
        check_strokes(strokes, 200, 80, "s")
    outside = read_strokes(write(tmp_path, {**HEAD, **TREE, "branches": [[[30, 70], [30, 300]]]}))
    with pytest.raises(CaptureError, match="a stroke of the branch of tree 1"):
        check_strokes(outside, 100, 80, "s")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(CaptureError, match=r"none\.json"):
        read_strokes(tmp_path / "none.json")


def test_settings_beside_strokes_are_kept(tmp_path):
    chosen = {"depth": 1.5, "gravity": -0.25, "seed": 7}
    strokes = read_strokes(write(tmp_path, {**HEAD, **TREE, "settings": chosen}))
    assert strokes.choices == SketchChoices(depth=1.5, gravity=-0.25, seed=7)
    assert json.loads(format_strokes(strokes))["settings"] == chosen
    assert "settings" not in json.loads(format_strokes(read_strokes(write(tmp_path, {**HEAD, **TREE}))))


@pytest.mark.parametrize(
    ("chosen", "words"),
    [
        ([1], "settings must be a table"),
        ({"colour": 1}, "settings has no 'colour'"),
        ({"depth": "deep"}, "depth of settings must be a number"),
        ({"depth": True}, "depth of settings must be a number"),
        ({"depth": 1e400}, "depth of settings must be a number"),
        ({"seed": 1.5}, "seed of settings must be a whole number"),
    ],
)
def test_settings_that_are_none_are_refused(tmp_path, chosen, words):
    with pytest.raises(CaptureError, match=words):
        read_strokes(write(tmp_path, {**HEAD, **TREE, "settings": chosen}))


def test_what_was_chosen_stands_over_other_choices():
    merged = SketchChoices(depth=2.0).over(SketchChoices(depth=1.0, seed=3))
    assert merged == SketchChoices(depth=2.0, seed=3)
