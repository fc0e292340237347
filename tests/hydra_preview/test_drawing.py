"""The drawing of a window: strokes, values and the way back, without a window."""

import math

import drawing as d
import pytest
from hypothesis import given
from hypothesis import strategies as st

CROWN = ((10.0, 10.0), (90.0, 10.0), (90.0, 80.0), (10.0, 80.0))
TRUNK = ((50.0, 120.0), (50.0, 60.0))
HEAD = {"image": "oak.png", "width": 100, "height": 130}


def drawn(*strokes) -> d.Drawing:
    drawing = d.Drawing()
    for kind, line in strokes:
        drawing = d.draw_stroke(drawing, kind, line)
    return drawing


def test_a_crown_takes_the_place_of_the_one_before_and_branches_add_up():
    drawing = drawn((d.CROWN, CROWN), (d.BRANCH, TRUNK), (d.CROWN, CROWN[:3]), (d.BRANCH, TRUNK[::-1]))
    assert drawing.tree == d.DrawnTree(crown=CROWN[:3], branches=(TRUNK, TRUNK[::-1]))


def test_points_are_those_of_a_file_and_none_follows_itself():
    drawing = drawn((d.BRANCH, ((1.0049, 2.0), (1.0, 2.001), (3.14159, 4.0))))
    assert drawing.tree.branches == (((1.0, 2.0), (3.14, 4.0)),)


def test_a_stroke_is_deleted_and_the_others_stay():
    drawing = drawn((d.CROWN, CROWN), (d.BRANCH, TRUNK), (d.BRANCH, TRUNK[::-1]))
    assert d.delete_stroke(drawing, d.Stroke(d.BRANCH, 0)).tree.branches == (TRUNK[::-1],)
    assert d.delete_stroke(drawing, d.Stroke(d.CROWN)).tree.crown == ()


def test_the_nearest_stroke_is_found_also_where_a_crown_is_closed():
    tree = drawn((d.CROWN, CROWN), (d.BRANCH, TRUNK)).tree
    assert d.find_stroke(tree, (52, 100), 4) == d.Stroke(d.BRANCH, 0)
    assert d.find_stroke(tree, (11, 45), 4) == d.Stroke(d.CROWN)  # between its last point and its first one
    assert d.find_stroke(tree, (30, 45), 4) is None


LINES = st.lists(st.tuples(st.floats(0, 1000), st.floats(0, 1000)), min_size=2, max_size=30).map(tuple)


@given(line=LINES, tolerance=st.floats(0.1, 50))
def test_a_simpler_line_keeps_its_ends_and_stays_near(line, tolerance):
    simple = d.simplify(line, tolerance)
    assert (simple[0], simple[-1]) == (line[0], line[-1])
    assert all(d.distance_to(simple, point) <= tolerance + 1e-6 for point in line)


def test_a_long_stroke_of_the_mouse_is_made_simple():
    line = tuple((x, 50 * math.sin(x / 40)) for x in range(20_000))
    assert len(d.simplify(line, 0.5)) < 5000


def test_undo_goes_back_to_the_start_and_redo_to_the_end():
    history = d.History()
    drawings = [drawn((d.CROWN, CROWN)), drawn((d.CROWN, CROWN), (d.BRANCH, TRUNK))]
    for each in drawings:
        history = history.do(each)
    assert history.undo().now == drawings[0]
    assert history.undo().undo().now == d.Drawing()
    assert history.undo().undo().undo().now == d.Drawing()
    assert history.undo().undo().redo().redo().redo().now == drawings[1]
    assert not history.undo().do(drawings[0].with_tree(d.DrawnTree())).after
    assert history.do(drawings[1]) == history  # nothing changed


def test_what_is_saved_is_known_after_undo_too():
    history = d.History()
    assert history.is_saved
    history = history.do(drawn((d.CROWN, CROWN)))
    assert not history.is_saved
    history = history.mark_saved().do(d.choose_value(history.now, "depth", 2.0))
    assert not history.is_saved
    assert history.undo().is_saved


def test_values_are_part_of_the_drawing_and_of_its_file():
    assert not d.choose_value(d.choose_value(drawn((d.CROWN, CROWN)), "seed", 3), "seed", None).values
    drawing = d.choose_value(d.choose_value(drawn((d.CROWN, CROWN)), "seed", 3), "depth", 1.5)
    strokes = d.to_strokes(drawing, HEAD)
    assert strokes["settings"] == {"depth": 1.5, "seed": 3}
    assert d.from_strokes(strokes) == drawing


def test_several_trees_go_into_a_file_without_empty_ones():
    drawing = d.add_tree(drawn((d.CROWN, CROWN), (d.BRANCH, TRUNK)))
    assert drawing.current == 1
    assert d.add_tree(drawing) == drawing  # an empty one is there
    assert len(d.to_strokes(drawing, HEAD)["trees"]) == 1
    drawing = d.draw_stroke(drawing, d.CROWN, CROWN[::-1])
    assert d.place_of_tree(drawing) == 1
    assert [tree["crown"][0] for tree in d.to_strokes(drawing, HEAD)["trees"]] == [[10.0, 10.0], [10.0, 80.0]]


@pytest.mark.parametrize(
    ("drawing", "words"), [(d.Drawing(), "nothing is drawn"), (drawn((d.BRANCH, TRUNK)), "no crown")]
)
def test_what_is_unfinished_is_not_saved(drawing, words):
    with pytest.raises(d.UnfinishedError, match=words):
        d.to_strokes(drawing, HEAD)
