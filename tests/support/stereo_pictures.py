"""Views of known textured planes, for what finds depth in photographs."""

import numpy as np
from scipy.spatial.transform import Rotation
from usdfoliage.capture.mvs.patch_match import MatchedPlanes
from usdfoliage.capture.view import View
from usdfoliage.geometry.pinhole import Pinhole

WIDTH, HEIGHT, FOCAL = 96, 72, 110.0


def camera(x=0.0, y=0.0, turn=(0.0, 0.0, 0.0)):
    rotation = Rotation.from_rotvec(turn).as_matrix()
    return Pinhole(
        width_px=WIDTH,
        height_px=HEIGHT,
        focal_px=(FOCAL, FOCAL),
        center_px=(WIDTH / 2, HEIGHT / 2),
        cam_from_world=np.column_stack([rotation, -rotation @ (x, y, 0.0)]),
    )


CAMERAS = (camera(), camera(0.1), camera(-0.1, 0.02, (0, 0.05, 0)), camera(0, 0.1, (-0.04, 0, 0.02)))


def texture(points):
    """Brightness (..., 0 to 1) of points of the world: waves in many directions."""
    rng = np.random.default_rng(4)
    waves, phases = rng.normal(size=(24, 3)) * 45, rng.uniform(0, 2 * np.pi, 24)
    return 0.5 + np.sin(points @ waves.T + phases).mean(axis=-1)


def everywhere(points):
    return np.ones(points.shape[:-1], bool)


GRAY = (1.0, 1.0, 1.0)
SLANTED = [(np.array([0.35, -0.2, 0.9]), everywhere, GRAY)]
STEP = [
    (np.array([0, 0, 1 / 1.4]), everywhere, GRAY),
    (np.array([0, 0, 1.0]), lambda points: points[..., 0] < 0, (0.4, 1.0, 0.3)),
]


def draw(cam, surfaces, name="", plain=False):
    """A view of planes n X = 1 of the world, the nearest before the others: normal, extent and tint of each."""
    rays = cam.rays() @ cam.cam_from_world[:, :3]
    origin = cam.position_m
    depth = np.full((HEIGHT, WIDTH), np.inf)
    tint = np.zeros((HEIGHT, WIDTH, 3))
    for normal, is_on_surface, color in surfaces:
        away = (1 - origin @ normal) / (rays @ normal)
        hit = (away > 0) & is_on_surface(origin + away[..., None] * rays) & (away < depth)
        depth = np.where(hit, away, depth)
        tint[hit] = color
    points = origin + np.where(np.isfinite(depth), depth, 0)[..., None] * rays
    bright = np.where(np.isfinite(depth), 0.5 if plain else texture(points), 0.5)
    srgb = np.rint(np.clip(bright[..., None] * tint, 0, 1) * 255).astype(np.uint8)
    depth_m = np.where(np.isfinite(depth), depth, 0).astype(np.float32)
    return View(name=name, camera=cam, srgb=srgb, depth_m=depth_m)


def exact_planes(cam, normal):
    """What PatchMatch should find of one plane n X = 1 of the world."""
    m = cam.cam_from_world[:, :3] @ normal / (1 - normal @ cam.position_m)
    planes = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    planes[..., 0] = cam.rays() @ m
    planes[..., 1], planes[..., 2] = m[0] / FOCAL, m[1] / FOCAL
    return MatchedPlanes(camera=cam, planes=planes, cost=np.zeros((HEIGHT, WIDTH), np.float32))


def inside(border=8):
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[border:-border, border:-border] = True
    return mask
