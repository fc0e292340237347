"""Cameras see the whole of a bound, no more than needed, from their given directions."""

import importlib.util
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pxr import Gf, Usd, UsdGeom

from tests.support.preview_stages import define_mesh, new_stage, write_ball

SOURCE = Path(__file__).resolve().parents[2] / "hydra_preview"


def load(name):
    """A module of hydra_preview under its own name, as it is there; it is a folder of scripts, not a package."""
    specification = importlib.util.spec_from_file_location(name, SOURCE / f"{name}.py")
    module = importlib.util.module_from_spec(specification)
    sys.modules[name] = module
    specification.loader.exec_module(module)
    return module


framing, record = load("framing"), load("record")

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


def shape_of_bound(bound):
    """The shape of which no more is known than its bound."""
    corners = tuple(bound.GetCorner(i) for i in range(8))
    return framing.Shape(middle=bound.GetMidpoint(), corners=corners, reach=bound.GetSize().GetLength())


def project(camera, bound):
    """Corners of the bound on the picture, each coordinate in -1 to 1, and depth likewise."""
    matrix = camera.frustum.ComputeViewMatrix() * camera.frustum.ComputeProjectionMatrix()
    return [matrix.Transform(bound.GetCorner(i)) for i in range(8)]


@settings(max_examples=60, deadline=None)
@given(bound=bounds, direction=directions, width=pixels, height=pixels, z_up=st.booleans())
def test_a_perspective_picture_holds_the_bound_and_touches_its_margin(bound, direction, width, height, z_up):
    camera = framing.frame_perspective(shape_of_bound(bound), direction, z_up, width, height)
    corners = project(camera, bound)
    reach = max(max(abs(c[0]), abs(c[1])) for c in corners)
    assert reach == pytest.approx(1 - 2 * framing.MARGIN, rel=1e-3)
    assert all(-1 <= c[2] <= 1 for c in corners)
    assert camera.aspectRatio == pytest.approx(width / height, rel=1e-5)


@settings(max_examples=60, deadline=None)
@given(bound=bounds, direction=directions, width=pixels, height=pixels, z_up=st.booleans())
def test_an_orthographic_picture_holds_the_bound_and_touches_its_margin(bound, direction, width, height, z_up):
    window = framing.fit_window(shape_of_bound(bound), direction, z_up, width, height)
    camera = framing.frame_orthographic(shape_of_bound(bound), direction, z_up, window)
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
def test_cameras_stand_in_their_direction(azimuth_deg, elevation_deg, y_up, z_up):
    direction = framing.Direction(azimuth_rad=math.radians(azimuth_deg), elevation_rad=math.radians(elevation_deg))
    assert Gf.IsClose(framing.camera_axes(direction, False)[2], Gf.Vec3d(*y_up), 1e-9)
    assert Gf.IsClose(framing.camera_axes(direction, True)[2], Gf.Vec3d(*z_up), 1e-9)


def test_a_shared_distance_is_kept():
    bound = Gf.Range3d(Gf.Vec3d(-1, 0, -3), Gf.Vec3d(1, 4, 3))
    front = framing.Direction(azimuth_rad=0, elevation_rad=0)
    camera = framing.frame_perspective(shape_of_bound(bound), front, False, 100, 100, distance=50)
    assert camera.transform.ExtractTranslation() == Gf.Vec3d(0, 2, 50)


def measured(stage, purposes=("default", "render")):
    return record.measure_shape(stage, Usd.TimeCode.Default(), list(purposes))


def test_a_mesh_counts_with_its_points(tmp_path):
    write_ball(tmp_path / "ball.usda", 2.0, (5.0, 0.0, 0.0), rings=40)
    stage = Usd.Stage.Open(str(tmp_path / "ball.usda"))
    UsdGeom.XformCommonAPI(stage.GetPrimAtPath("/Thing")).SetTranslate((0, 100, 0))
    shape = measured(stage)
    assert Gf.IsClose(shape.middle, Gf.Vec3d(5, 100, 0), 1e-4)
    assert 100 < len(shape.corners) <= 1000
    distances = [(corner - shape.middle).GetLength() for corner in shape.corners]
    assert distances == pytest.approx([2.0] * len(distances), abs=1e-4)
    for direction in np.random.default_rng(0).normal(size=(50, 3)):
        d = Gf.Vec3d(*direction).GetNormalized()
        assert max(Gf.Dot(corner - shape.middle, d) for corner in shape.corners) > 2.0 * 0.99  # of 40 rings, too


def test_a_mesh_that_a_shader_displaces_counts_with_its_extent(tmp_path):
    write_ball(tmp_path / "ball.usda", 2.0, (0.0, 0.0, 0.0), rings=20)
    stage = Usd.Stage.Open(str(tmp_path / "ball.usda"))
    UsdGeom.Mesh.Get(stage, "/Thing/Ball").GetExtentAttr().Set([(-3, -3, -3), (3, 3, 4)])
    shape = measured(stage)
    assert sorted(map(tuple, shape.corners)) == [(x, y, z) for x in (-3, 3) for y in (-3, 3) for z in (-3, 4)]


def test_instances_count_with_the_bound_of_them_all_and_their_prototypes_not_at_all(tmp_path):
    stage = new_stage(tmp_path / "many.usda")
    instancer = UsdGeom.PointInstancer.Define(stage, "/Thing/Many")
    square = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
    define_mesh(stage, "/Thing/Many/Leaf", square, np.array([[0, 1, 2, 3]]))
    instancer.CreatePrototypesRel().AddTarget("/Thing/Many/Leaf")
    instancer.CreatePositionsAttr([(10, 0, 0), (20, 0, 3)])
    instancer.CreateProtoIndicesAttr([0, 0])
    xs, ys, zs = zip(*measured(stage).corners, strict=True)
    assert (min(xs), max(xs), min(ys), max(ys), min(zs), max(zs)) == (10, 21, 0, 1, 0, 3)


def test_what_is_not_drawn_does_not_count(tmp_path):
    stage = new_stage(tmp_path / "three.usda")
    square = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
    for place, name in enumerate(("Shown", "Guide", "Hidden")):
        define_mesh(stage, f"/Thing/{name}", square + 10 * place, np.array([[0, 1, 2, 3]]))
    UsdGeom.Imageable(stage.GetPrimAtPath("/Thing/Guide")).CreatePurposeAttr("guide")
    UsdGeom.Imageable(stage.GetPrimAtPath("/Thing/Hidden")).MakeInvisible()
    assert max(max(corner) for corner in measured(stage).corners) == 1
    assert max(max(corner) for corner in measured(stage, ["default", "guide"]).corners) == 11
    with pytest.raises(
        record.RecordError, match="no geometry of purpose proxy; it has geometry of purpose default, guide"
    ):
        measured(stage, ["proxy"])
