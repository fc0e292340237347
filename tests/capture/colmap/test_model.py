import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from usdfoliage.capture.colmap.model import find_camera_model, read_camera_model, read_model_points
from usdfoliage.capture.lens import LENS_MODELS, Lens
from usdfoliage.errors import CaptureError

from tests.support import captures
from tests.support.captures import LENS, ring, write_binary_model, write_text_model

POINTS = np.array([[0.5, -1.25, 3.0], [1e-3, 0.0, -7.5]])
QUARTER = "0.7071068 0 0.7071068 0"  # about y: x to -z


def lens_of(model: str) -> Lens:
    focal = (80.0, 82.0)[: LENS_MODELS[model].focal_lengths]
    distortion = [0.01 * (index + 1) for index in range(LENS_MODELS[model].distortion)]
    return Lens(model=model, width_px=64, height_px=48, parameters=(*focal, 33.0, 23.0, *distortion))


LENSES = [lens_of(model) for model in LENS_MODELS]


@pytest.fixture
def model(tmp_path):
    """A folder, and a way to overwrite a file of the model in it."""
    write_text_model(tmp_path, ring(2))

    def write(name: str, text: str) -> None:
        (tmp_path / name).write_text(text, encoding="utf-8")

    return tmp_path, write


def image_line(name: str = "a.jpg", pose: str = "1 0 0 0 0 0 0", camera: str = "1") -> str:
    return f"1 {pose} {camera} {name}\n\n"


@pytest.mark.parametrize("write", [write_text_model, write_binary_model])
def test_what_is_written_is_read(tmp_path, write):
    poses = ring(len(LENSES) + 1)
    write(tmp_path, poses, LENSES, points=POINTS)
    model = read_camera_model(tmp_path)
    assert list(model.lenses.values()) == LENSES
    assert [image.name for image in model.images] == sorted(poses)
    for image in model.images:
        np.testing.assert_allclose(image.cam_from_world, poses[image.name], atol=1e-14)
    assert [image.camera_id for image in model.images] == [*range(1, len(LENSES) + 1), 1]
    np.testing.assert_array_equal(read_model_points(tmp_path), POINTS)
    np.testing.assert_array_equal(read_model_points(tmp_path, max_points=1), POINTS[:1])


@pytest.mark.parametrize("observations", ["", "10.5 20.5 -1", "10.5 20.5 -1 1 2 3 4 5 6 7 8 9 10 11 12"])
def test_lines_of_points_are_passed_over(tmp_path, observations):
    write_text_model(tmp_path, ring(3), observations=observations)
    assert len(read_camera_model(tmp_path).images) == 3


def test_lines_of_points_may_be_left_out(model):
    folder, write = model
    write("images.txt", image_line("a.jpg").strip() + "\n" + image_line("b.jpg").strip())
    assert [image.name for image in read_camera_model(folder).images] == ["a.jpg", "b.jpg"]


def test_points_of_binary_images_are_passed_over(tmp_path):
    write_binary_model(tmp_path, ring(3), observations=17)
    assert len(read_camera_model(tmp_path).images) == 3


def test_no_points_are_none(tmp_path):
    assert read_model_points(tmp_path).shape == (0, 3)


def test_points_at_infinity_are_left_out(tmp_path):
    write_text_model(tmp_path, ring(1), points=np.array([[1e300, 0, 0], [1, 2, 3]]))
    np.testing.assert_array_equal(read_model_points(tmp_path), [[1, 2, 3]])


def test_a_quaternion_turns_the_world_into_the_camera(model):
    folder, write = model
    write("images.txt", image_line(pose=f"{QUARTER} 1 2 3"))
    (image,) = read_camera_model(folder).images
    np.testing.assert_allclose(image.cam_from_world @ (1, 0, 0, 1), (1, 2, 3 - 1), atol=1e-6)


@given(numbers=st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_poses_are_rotations(numbers):
    from usdfoliage.capture.colmap.posed_image import checked_image

    image = checked_image("", "a.jpg", 1, tuple(np.array(numbers) / np.linalg.norm(numbers)), (0.0, 0.0, 0.0))
    rotation = image.cam_from_world[:, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1)
    again = captures.quaternion(rotation) * np.sign(captures.quaternion(rotation) @ numbers)
    np.testing.assert_allclose(again, np.array(numbers) / np.linalg.norm(numbers), atol=1e-4)


def test_text_is_preferred_to_binary(tmp_path):
    write_binary_model(tmp_path, ring(3))
    write_text_model(tmp_path, ring(2))
    assert len(read_camera_model(tmp_path).images) == 2


@pytest.mark.parametrize("below", ["", "sparse/0"])
def test_the_model_is_found(tmp_path, below):
    write_text_model(tmp_path / below, ring(1))
    assert find_camera_model(tmp_path) == tmp_path / below


def test_the_error_of_a_missing_model_names_its_files(tmp_path):
    with pytest.raises(CaptureError, match=r"cameras\.txt and images\.txt"):
        find_camera_model(tmp_path)


def test_half_a_model_is_refused(model):
    folder, _ = model
    (folder / "cameras.txt").unlink()
    with pytest.raises(CaptureError, match=r"neither cameras\.txt nor cameras\.bin"):
        read_camera_model(folder)


@pytest.mark.parametrize("name", ["leaf 12 of 30.jpg", "day 1/a.jpg", "Blätter.jpg", "12:30.jpg", "1 2 3"])
def test_names(model, name):
    folder, write = model
    write("images.txt", image_line(name))
    assert [image.name for image in read_camera_model(folder).images] == [name]


@pytest.mark.parametrize(
    "name", ["../a.jpg", "/etc/passwd", "a/../../b.jpg", "..\\a.jpg", "C:\\a.jpg", "a//b.jpg", "a\x07.jpg"]
)
def test_names_stay_in_the_folder_of_images(model, name):
    folder, write = model
    write("images.txt", "# names\n" + image_line(name))
    with pytest.raises(CaptureError, match=r"images\.txt:2: .*stay inside the folder of images"):
        read_camera_model(folder)
    if "\x07" not in name:
        (folder / "images.txt").unlink()
        write_binary_model(folder, {name: ring(1)["000.png"]})
        with pytest.raises(CaptureError, match=r"images\.bin, byte 8: .*stay inside"):
            read_camera_model(folder)


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("cameras.txt", "1 PINHOLE 64\n", r"cameras\.txt:1: 3 fields"),
        (
            "cameras.txt",
            "\n1 THIN_PRISM_FISHEYE 64 48 1 1 1 1\n",
            r"cameras\.txt:2: .*THIN_PRISM_FISHEYE.*known are SIMPLE_PIN",
        ),
        ("cameras.txt", "1 PINHOLE 64 48 80 80 32\n", r"cameras\.txt:1: PINHOLE has 4 parameters, not 3"),
        ("cameras.txt", "1 PINHOLE 64 48 80 nan 32 24\n", r"cameras\.txt:1: nan must be finite"),
        ("cameras.txt", "1 PINHOLE 64 48 80 -80 32 24\n", r"cameras\.txt:1: the focal lengths must be in"),
        ("cameras.txt", "1 PINHOLE 64 48 80 1e300 32 24\n", r"cameras\.txt:1: the parameters must be finite"),
        ("cameras.txt", "1 PINHOLE 64 0 80 80 32 24\n", r"cameras\.txt:1: the sides must be"),
        ("cameras.txt", "1 PINHOLE 64.5 48 80 80 32 24\n", r"cameras\.txt:1: '64\.5' must be a whole number"),
        ("cameras.txt", "1 PINHOLE 64 48 80 80 32 24\n" * 2, r"cameras\.txt:2: camera 1 is there twice"),
        ("images.txt", "1 1 0 0 0 0 0 0 1\n", r"images\.txt:1: 9 fields"),
        ("images.txt", "1 1 0 0 0 0 0 x 1 a.jpg\n", r"images\.txt:1: 'x' must be a number"),
        (
            "images.txt",
            "1 0 0 0 0 0 0 0 1 a.jpg\n",
            r"images\.txt:1: the quaternion of 'a\.jpg' has length 0; it must be 1",
        ),
        ("images.txt", "1 2 0 0 0 0 0 0 1 a.jpg\n", r"images\.txt:1: .*length 2"),
        ("images.txt", "1 1e308 1e308 0 0 0 0 0 1 a.jpg\n", r"images\.txt:1: .*length"),
        ("images.txt", "1 nan 0 0 0 0 0 0 1 a.jpg\n", r"images\.txt:1: nan must be finite"),
        ("images.txt", "1 1 0 0 0 1e300 0 0 1 a.jpg\n", r"images\.txt:1: 'a\.jpg' is 1e\+300 units away"),
        ("images.txt", "1 1 0 0 0 0 0 0 7 a.jpg\n", r"images\.txt:1: camera 7 is unknown; there is 1"),
        ("images.txt", image_line() * 2, r"images\.txt:3: a\.jpg is there twice, first at .*images\.txt:1"),
        ("images.txt", "# nothing\n", r"images\.txt has no images"),
    ],
)
def test_bad_text_is_refused_by_line(model, file, text, message):
    folder, write = model
    write(file, text)
    with pytest.raises(CaptureError, match=message):
        read_camera_model(folder)


def test_bytes_are_no_text(model):
    folder, _ = model
    (folder / "images.txt").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(CaptureError, match=r"images\.txt is not text in UTF-8"):
        read_camera_model(folder)


@pytest.mark.parametrize("file", ["cameras.bin", "images.bin"])
def test_every_truncation_of_a_binary_model_is_refused(tmp_path, file):
    write_binary_model(tmp_path, ring(2), observations=1)
    data = (tmp_path / file).read_bytes()
    for length in range(0, len(data), 3):
        (tmp_path / file).write_bytes(data[:length])
        with pytest.raises(CaptureError, match=file):
            read_camera_model(tmp_path)


@pytest.mark.parametrize("file", ["cameras.bin", "images.bin", "points3D.bin"])
def test_a_promise_of_many_is_no_reason_to_take_memory(tmp_path, file):
    write_binary_model(tmp_path, ring(2), points=POINTS)
    data = (tmp_path / file).read_bytes()
    (tmp_path / file).write_bytes(b"\xff" * 8 + data[8:])
    read = read_model_points if file == "points3D.bin" else read_camera_model
    with pytest.raises(CaptureError, match=rf"{file}, byte \d+: \d+ bytes needed, \d+ are left"):
        read(tmp_path)


def test_an_unknown_number_of_a_model_is_refused(tmp_path):
    write_binary_model(tmp_path, ring(1))
    data = bytearray((tmp_path / "cameras.bin").read_bytes())
    data[12] = 10
    (tmp_path / "cameras.bin").write_bytes(data)
    with pytest.raises(
        CaptureError, match=r"cameras\.bin, byte 8: the camera model 10 is not known; known are SIMPLE_PIN"
    ):
        read_camera_model(tmp_path)


@pytest.mark.parametrize(
    "file", ["cameras.txt", "images.txt", "points3D.txt", "cameras.bin", "images.bin", "points3D.bin"]
)
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_whatever_is_damaged_is_a_capture_error(tmp_path, file, data):
    write = write_text_model if file.endswith(".txt") else write_binary_model
    write(tmp_path, ring(2), [LENS, lens_of("OPENCV")], points=POINTS)
    content = bytearray((tmp_path / file).read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(content)))
        content[place : place + data.draw(st.integers(0, 3))] = data.draw(st.binary(max_size=4))
    (tmp_path / file).write_bytes(content)
    try:
        model = read_camera_model(tmp_path)
        read_model_points(tmp_path)
    except CaptureError as error:
        assert file in str(error) or "is unknown" in str(error)  # noqa: PT017 - most are still right
    else:
        assert all(np.isfinite(image.cam_from_world).all() for image in model.images)
