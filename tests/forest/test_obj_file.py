"""OBJ files: what is read of them, and what is refused."""

import numpy as np
import pytest
from usdfoliage.errors import FoliageError
from usdfoliage.forest.obj_file import read_obj

POINTS = "v 0 0 1\nv 1 0 2 0.5 0.5 0.5\nv 1 1 3 1.0\nv 0 1 4\n"


def read(tmp_path, text: str | bytes):
    path = tmp_path / "ground.obj"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_obj(path, "the DEM")


@pytest.mark.parametrize(
    "face", ["f 1 2 3 4", "f 1/1 2/2 3/3 4/4", "f 1//9 2//9 3//9 4//9", "f -4 -3 -2 -1", "f 1 2 \\\n3 4"]
)
def test_faces_are_read_in_every_form(tmp_path, face):
    mesh = read(tmp_path, f"mtllib a.mtl\n\n{POINTS}vt 0 0\nvn 0 0 1\ng a\ns off\n{face}\r\nl 1 2\n")
    np.testing.assert_array_equal(mesh.points[:, 2], [1, 2, 3, 4])
    np.testing.assert_array_equal(mesh.triangles, [[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize(
    ("text", "about"),
    [
        ("", "no points and no faces"),
        (POINTS, "4 points and no faces"),
        ("v 0 0 nan\n", "line 1 no point"),
        ("# a\nv 0 1e999 0\n", "line 2 no point"),
        ("v 0 0 1e300\n", "line 1 no point"),
        ("v 0 0\n", "line 1 no point"),
        (POINTS + "f 1 2\n", "line 5 no face"),
        (POINTS + "f 1 2 5\n", "line 5 no face"),
        (POINTS + "f 1 2 0\n", "line 5 no face"),
        (POINTS + "f 1 2 -5\n", "line 5 no face"),
        (POINTS + "f 1 2 " + "9" * 9000 + "\n", "line 5 no face"),
        (b"v \x1b[31m\xff 0 0\n", "line 1 no point"),
        (b"\0" * 5_000_000, "line 1 no point"),
        ("f " + "1 " * 2_000_000, "line 1 no face"),
    ],
)
def test_what_is_no_mesh_is_one_line_that_names_the_file(tmp_path, text, about):
    with pytest.raises(FoliageError, match=about) as caught:
        read(tmp_path, text)
    assert "ground.obj" in str(caught.value)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 400 + len(str(tmp_path))


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(FoliageError, match="not there"):
        read_obj(tmp_path / "none.obj", "the DEM")
