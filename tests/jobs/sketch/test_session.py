"""What the window of a photograph asks, answered without a window."""

import io
import json
import os
import threading

import cv2
import numpy as np
import pytest
from usdfoliage.capture.folder.images import read_photo
from usdfoliage.jobs.sketch.session import DrawingSession, answer_drawing

from tests.support.photographs.drawn_trees import draw_leafy


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    folder = tmp_path_factory.mktemp("session")
    tree = draw_leafy()
    cv2.imwrite(str(folder / "oak.png"), tree.srgb[..., ::-1])
    return tree, read_photo(folder / "oak.png"), folder


def ask(drawn, tmp_path, *orders) -> list[dict]:
    """Every reply to orders that come at once."""
    session = DrawingSession(photo=drawn[1], color_space=None, work=tmp_path)
    requests = io.BytesIO(b"".join(json.dumps(order).encode() + b"\n" for order in orders))
    replies = io.BytesIO()
    answer_drawing(session, requests, replies)
    return [json.loads(line) for line in replies.getvalue().splitlines()]


def tree_of(drawn, **changed) -> dict:
    strokes = drawn[0].strokes
    branches = [line.tolist() for line in strokes.branches_px]
    return {"crown": strokes.crown_px.tolist(), "branches": branches, **changed}


def strokes_of(drawn, **changed) -> dict:
    return {"image": "oak.png", "width": 300, "height": 400, **tree_of(drawn), **changed}


def test_strokes_are_traced_roughly_at_once_and_then_exactly(drawn, tmp_path):
    rough, exact = ask(drawn, tmp_path, {"id": 1, "op": "trace", "tree": tree_of(drawn)})
    assert (rough["rough"], exact["rough"]) == (True, False)
    leaves = drawn[0].leaves
    for reply, agreeing in ((rough, 0.9), (exact, 0.95)):
        found = cv2.imread(reply["foliage"], cv2.IMREAD_GRAYSCALE) > 0
        assert (found & leaves).sum() / (found | leaves).sum() > agreeing
        (trunk,) = reply["branches"]
        assert abs(np.array(trunk)[:, 0] - 150).max() < 6


def test_another_branch_of_the_same_crown_is_traced_without_looking_for_leaves_again(drawn, tmp_path):
    session = DrawingSession(photo=drawn[1], color_space=None, work=tmp_path)
    replies: list[dict] = []
    alone, with_trunk = {"tree": tree_of(drawn, branches=[])}, {"tree": tree_of(drawn)}
    assert not session.trace(alone, replies.append)
    assert not session.trace(with_trunk, replies.append)  # of the rough leaves
    session.trace_exactly(with_trunk, lambda: True, replies.append)
    assert session.trace(with_trunk, replies.append)
    assert [each["rough"] for each in replies] == [True, True, False, False]
    assert [len(each["branches"]) for each in replies] == [0, 1, 1, 1]
    assert len(list(tmp_path.glob("*leaves.png"))) == 3  # the last few


def test_leaves_that_nobody_waits_for_are_not_sent(drawn, tmp_path):
    session = DrawingSession(photo=drawn[1], color_space=None, work=tmp_path)
    session.trace_exactly({"tree": tree_of(drawn)}, lambda: False, pytest.fail)


def test_of_strokes_that_wait_the_last_is_traced(drawn, tmp_path):
    orders = [{"id": number, "op": "trace", "tree": tree_of(drawn)} for number in range(1, 9)]
    replies = ask(drawn, tmp_path, *orders)
    assert replies[-1]["id"] == 8
    assert len({each["id"] for each in replies}) < 5


def test_a_growth_that_is_stopped_ends(drawn, tmp_path):
    session = DrawingSession(photo=drawn[1], color_space=None, work=tmp_path)
    asked, asks = os.pipe()
    answered, answers = os.pipe()
    with os.fdopen(asked, "rb") as requests, os.fdopen(answers, "wb") as replies, os.fdopen(asks, "wb") as mine:
        thread = threading.Thread(target=answer_drawing, args=(session, requests, replies))
        thread.start()
        order = {"id": 7, "op": "grow", "strokes": strokes_of(drawn), "tree": 0}
        mine.write(json.dumps(order).encode() + b"\n")
        mine.flush()
        with os.fdopen(answered, "rb") as received:
            assert json.loads(received.readline())["step"] == "tree"
            mine.write(b'{"id": 0, "op": "stop"}\n')
            mine.close()
            thread.join()
            replies.close()
            last = json.loads(received.read().splitlines()[-1])
    assert last == {"id": 7, "stopped": True}
    assert not list(tmp_path.glob("*draft*"))


@pytest.mark.parametrize(
    ("order", "words"),
    [
        ({"op": "fly"}, "nothing is known of 'fly'"),
        ({"op": "read", "path": "/none/a.json"}, "cannot be read"),
        ({"op": "write", "path": "/none/a.json", "strokes": {}}, "holds no strokes"),
        ({"op": "grow", "strokes": [], "tree": 0}, "holds no strokes"),
        ({"op": "trace", "tree": {"crown": [[0, 0], [1, "x"]], "branches": []}}, "could not convert"),
        ({"op": "trace", "tree": {"crown": [[9e5, 9e5], [9e5, 9.1e5], [9.1e5, 9e5]], "branches": []}}, "holds nothing"),
        ({"op": "trace"}, "tree"),
    ],
)
def test_what_cannot_be_is_an_error_to_its_number(drawn, tmp_path, order, words):
    (reply,) = ask(drawn, tmp_path, {"id": 3, **order})
    assert reply["id"] == 3
    assert words in reply["error"]


def test_values_out_of_range_and_trees_that_are_not_there_do_not_grow(drawn, tmp_path):
    deep = {"id": 1, "op": "grow", "strokes": strokes_of(drawn, settings={"depth": 9}), "tree": 0}
    third = {"id": 2, "op": "grow", "strokes": strokes_of(drawn), "tree": 2}
    assert "depth must be" in ask(drawn, tmp_path, deep)[-1]["error"]
    assert "error" in ask(drawn, tmp_path, third)[-1]


def test_lines_that_are_no_orders_are_passed_over(drawn, tmp_path):
    session = DrawingSession(photo=drawn[1], color_space=None, work=tmp_path)
    replies = io.BytesIO()
    answer_drawing(session, io.BytesIO(b'{\n[]\n{"op": "trace"}\n{"id": 4, "op": "fly"}\n'), replies)
    assert [json.loads(line)["id"] for line in replies.getvalue().splitlines()] == [4]
