"""Cameras see the whole of a bound, no more than needed, from where they are said to stand."""

import importlib.util
import math
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pxr import Gf

SOURCE = Path(__file__).resolve().parents[2] / "hydra_preview" / "framing.py"
specification = importlib.util.spec_from_file_location("preview_framing", SOURCE)
framing = importlib.util.module_from_spec(specification)
sys.modules["preview_framing"] = framing
specification.loader.exec_module(framing)

sides = st.floats(0.01, 100)
places = st.floats(-1000, 1000)
bounds = st.builds(
    lambda x, y, z, a, b, c: Gf.Range3d(Gf.Vec3d(x, y, z), Gf.Vec3d(x + a, y + b, z + c)),
    *(places, places, places, sides, sides, sides),
)
directions = st.builds(
    lambda a, e: framing.Direction(azimuth_rad=a, elevation_rad=e),
    st.floats(-math.pi, math.pi),
    st.floats(-math.pi / 2, math.pi / 2),
)
pixels = st.integers(16, 4000)


def project(camera, bound):
    """Corners of the bound on the picture, each coordinate in -1 to 1, and depth likewise."""
    matrix = camera.frustum.ComputeViewMatrix() * camera.frustum.ComputeProjectionMatrix()
    return [matrix.Transform(bound.GetCorner(i)) for i in range(8)]


@settings(max_examples=60, deadline=None)
@given(bound=bounds, direction=directions, width=pixels, height=pixels, z_up=st.booleans())
def test_a_perspective_picture_holds_the_bound_and_touches_its_margin(bound, direction, width, height, z_up):
    camera = framing.frame_perspective(bound, direction, z_up, width, height)
    corners = project(camera, bound)
    reach = max(max(abs(c[0]), abs(c[1])) for c in corners)
    assert reach == pytest.approx(1 - 2 * framing.MARGIN, rel=1e-3)
    assert all(-1 <= c[2] <= 1 for c in corners)
    assert camera.aspectRatio == pytest.approx(width / height, rel=1e-5)


@settings(max_examples=60, deadline=None)
@given(bound=bounds, direction=directions, width=pixels, height=pixels, z_up=st.booleans())
def test_an_orthographic_picture_holds_the_bound_and_touches_its_margin(bound, direction, width, height, z_up):
    window = framing.fit_window(bound, direction, z_up, width, height)
    camera = framing.frame_orthographic(bound, direction, z_up, window)
    corners = project(camera, bound)
    assert max(max(abs(c[0]), abs(c[1])) for c in corners) == pytest.approx(1 - 2 * framing.MARGIN, rel=1e-3)
    assert all(-1 <= c[2] <= 1 for c in corners)
    assert camera.aspectRatio == pytest.approx(width / height, rel=1e-4)


@pytest.mark.parametrize("z_up", [False, True])
@given(direction=directions)
@settings(max_examples=30, deadline=None)
def test_axes_are_right_handed_and_the_picture_stands_upright(direction, z_up):
    right, up, backward = framing.camera_axes(direction, z_up)
    assert Gf.IsClose(Gf.Cross(right, up), backward, 1e-9)
    vertical = 2 if z_up else 1
    assert right[vertical] == pytest.approx(0, abs=1e-12)
    assert up[vertical] >= -1e-12


@pytest.mark.parametrize(
    ("azimuth_deg", "elevation_deg", "y_up", "z_up"),
    [
        (0, 0, (0, 0, 1), (0, -1, 0)),
        (90, 0, (1, 0, 0), (1, 0, 0)),
        (180, 0, (0, 0, -1), (0, 1, 0)),
        (0, 90, (0, 1, 0), (0, 0, 1)),
    ],
)
def test_cameras_stand_where_their_direction_says(azimuth_deg, elevation_deg, y_up, z_up):
    direction = framing.Direction(azimuth_rad=math.radians(azimuth_deg), elevation_rad=math.radians(elevation_deg))
    assert Gf.IsClose(framing.camera_axes(direction, False)[2], Gf.Vec3d(*y_up), 1e-9)
    assert Gf.IsClose(framing.camera_axes(direction, True)[2], Gf.Vec3d(*z_up), 1e-9)


def test_a_shared_distance_is_kept():
    bound = Gf.Range3d(Gf.Vec3d(-1, 0, -3), Gf.Vec3d(1, 4, 3))
    front = framing.Direction(azimuth_rad=0, elevation_rad=0)
    camera = framing.frame_perspective(bound, front, False, 100, 100, distance=50)
    assert camera.transform.ExtractTranslation() == Gf.Vec3d(0, 2, 50)
