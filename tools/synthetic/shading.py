"""Plausible photographs: sun, shade, veins, soil and plaster.

Nothing is measured of them. They are what segmentation may meet: leaves of like colours over each other, light spots,
veins that are no edges.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from usdfoliage.geometry.color import encode_srgb
from usdfoliage.geometry.pinhole import Pinhole

from tools.synthetic.raster import rasterise
from tools.synthetic.scene import Bark, Scene

Array = NDArray[np.float64]

SUN = np.array([-0.45, 1.0, 0.75]) / np.linalg.norm([-0.45, 1.0, 0.75])
SUN_COLOR, SKY_COLOR, BOUNCE_COLOR = (
    np.array([2.3, 2.15, 1.9]),
    np.array([0.62, 0.72, 0.85]),
    np.array([0.2, 0.16, 0.1]),
)
BARK, SOIL, PLASTER = np.array([0.10, 0.07, 0.045]), np.array([0.075, 0.055, 0.038]), np.array([0.30, 0.285, 0.26])
SHADOW_TEXELS = 1536  # across all that stands on the ground, at most
TEXELS_A_LEAF = 24
SKY_DIRECTIONS = 16
NOISE_SIZE = 512
FAR = 120.0  # leaf lengths; beyond it the ground fades and no depth is known


@dataclass(frozen=True, kw_only=True, eq=False)
class ShadowMap:
    """How near to a light far away its rays first meet something."""

    light_from_world: Array  # (3, 3), rows: across, up, towards the light
    origin: Array  # (2,), of the map in those axes
    texel_m: float
    height: NDArray[np.float32]  # (H, W), along the direction to the light, of the first that it meets
    bias_m: float

    def lit(self, points_m: Array) -> Array:
        """Share (K,) of the light that comes through to points (K, 3), soft over two texels."""
        place = points_m @ self.light_from_world.T
        columns, rows = ((place[:, :2] - self.origin) / self.texel_m).T
        lit = np.zeros(len(points_m))
        shifts = (-0.75, 0.25), (0.25, 0.75), (0.75, -0.25), (-0.25, -0.75)
        for shift_x, shift_y in shifts:
            column = np.floor(columns + shift_x).astype(np.int64)
            row = np.floor(rows + shift_y).astype(np.int64)
            inside = (column >= 0) & (row >= 0) & (column < self.height.shape[1]) & (row < self.height.shape[0])
            first = np.full(len(points_m), -np.inf)
            first[inside] = self.height[row[inside], column[inside]]
            lit += place[:, 2] >= first - self.bias_m
        return lit / len(shifts)


@dataclass(frozen=True, kw_only=True, eq=False)
class Light:
    """What is prepared once for all views of a scene."""

    sun: ShadowMap
    open_sky: Array  # (V,), share of the sky that a vertex sees
    ground_sky: NDArray[np.float32]  # (G, G), the same of the ground
    ground_low: Array  # (2,), x and z of the middle of its first texel
    ground_step: Array  # (2,)
    noise: NDArray[np.float32]  # (NOISE_SIZE, NOISE_SIZE), periodic, mean 0, standard deviation 1
    leaf_noise: Array  # (N, 2), where on it each leaf lies
    length_m: float  # of a leaf, on average


def light_scene(scene: Scene, seed: int) -> Light:
    """Shadows of the sun, and how much of the sky each vertex and the ground see."""
    rng = np.random.default_rng((seed, 1))
    length_m = float(scene.leaves.length_m.mean())
    low, high = scene.points_m.min(axis=0) - length_m, scene.points_m.max(axis=0) + length_m
    grid = 96
    x, z = np.linspace(low[0], high[0], grid), np.linspace(low[2], high[2], grid)
    ground = np.stack(np.broadcast_arrays(x[None, :], 0.0, z[:, None]), axis=-1).reshape(-1, 3)
    everything = np.concatenate([scene.points_m, ground])
    seen = np.zeros(len(everything))
    directions = _sky_directions(SKY_DIRECTIONS)
    for direction in directions:
        seen += _shadow_map(scene, direction, TEXELS_A_LEAF / 2, SHADOW_TEXELS // 4, length_m).lit(everything)
    seen /= len(directions)
    return Light(
        sun=_shadow_map(scene, SUN, TEXELS_A_LEAF * 1.5, SHADOW_TEXELS, length_m),
        open_sky=seen[: len(scene.points_m)],
        ground_sky=seen[len(scene.points_m) :].reshape(grid, grid).astype(np.float32),
        ground_low=low[[0, 2]],
        ground_step=(high - low)[[0, 2]] / (grid - 1),
        noise=_periodic_noise(rng),
        leaf_noise=rng.random((len(scene.leaves), 2)) * NOISE_SIZE,
        length_m=length_m,
    )


def photograph(
    scene: Scene, light: Light, camera: Pinhole, rng: np.random.Generator, samples: int = 2
) -> NDArray[np.uint8]:
    """The picture (H, W, 3), sRGB, of samples x samples rays a pixel."""
    fine = Pinhole(
        width_px=camera.width_px * samples,
        height_px=camera.height_px * samples,
        focal_px=(camera.focal_px[0] * samples, camera.focal_px[1] * samples),
        center_px=(camera.center_px[0] * samples, camera.center_px[1] * samples),
        cam_from_world=camera.cam_from_world,
    )
    # Ground and wall have no edges to smooth but where they meet: one ray a pixel.
    behind = _backdrop(scene, light, camera).repeat(samples, axis=0).repeat(samples, axis=1)
    linear = _radiance(scene, light, fine, behind).reshape(camera.height_px, samples, camera.width_px, samples, 3)
    linear = linear.mean(axis=(1, 3)) * np.exp(rng.uniform(-0.04, 0.04))
    linear += rng.normal(0, 1, linear.shape) * (0.003 + 0.012 * np.sqrt(linear))  # as a small sensor
    toned = 1 - np.exp(-1.2 * np.maximum(linear, 0))
    return np.asarray(np.round(255 * np.clip(encode_srgb(toned), 0, 1)), np.uint8)


def _radiance(scene: Scene, light: Light, camera: Pinhole, image: Array) -> Array:
    """Linear colours (H, W, 3) of what is seen through every pixel's centre: the plant over an image (H, W, 3)."""
    places, depth = camera.project(scene.points_m)
    inverse = 1 / depth
    size = camera.height_px, camera.width_px
    hits = rasterise(places, inverse, scene.triangles, size)
    rows, columns = np.nonzero(hits.triangle >= 0)
    weights = hits.weights(places, inverse, scene.triangles)
    triangle = hits.triangle[rows, columns]
    corners = scene.triangles[triangle]

    def interpolate(values: Array) -> Array:
        return np.asarray(np.einsum("kc,kc...->k...", weights, values[corners]))

    points = interpolate(scene.points_m)
    normals = interpolate(scene.normals)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    to_eye = camera.position_m - points
    to_eye /= np.linalg.norm(to_eye, axis=1, keepdims=True)
    below = (normals * to_eye).sum(axis=1) < 0
    normals[below] *= -1
    leaf = scene.leaf[triangle]
    on_leaf = leaf >= 0
    albedo = np.tile(BARK, (len(leaf), 1))
    if scene.bark is not None:
        albedo[~on_leaf] = _bark_albedo(scene.bark, light, points[~on_leaf], normals[~on_leaf])
    uv = interpolate(scene.uv)
    albedo[on_leaf] = _leaf_albedo(scene, light, leaf[on_leaf], uv[on_leaf], below[on_leaf])
    sun = light.sun.lit(points)
    image[rows, columns] = _shade(
        albedo, normals, sun, interpolate(light.open_sky), to_eye, translucent=on_leaf, glossy=on_leaf & ~below
    )
    return image


def _shade(
    albedo: Array,
    normals: Array,
    sun: Array,
    sky: Array,
    to_eye: Array,
    translucent: NDArray[np.bool_],
    glossy: NDArray[np.bool_],
) -> Array:
    facing = normals @ SUN
    direct = np.maximum(facing, 0)[:, None] * SUN_COLOR * sun[:, None]
    up = 0.5 + 0.5 * normals[:, 1:2]
    around = sky[:, None] * (up * SKY_COLOR + (1 - up) * BOUNCE_COLOR) + 0.04
    color = albedo * (direct + around)
    through = np.where(translucent, np.maximum(-facing, 0) * sun, 0.0)[:, None]
    color += albedo * np.array([1.0, 1.05, 0.45]) * 0.55 * SUN_COLOR * through
    half = SUN + to_eye
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    shine = np.where(glossy, np.maximum((normals * half).sum(axis=1), 0) ** 24 * (facing > 0), 0.0)
    color += 0.09 * (shine * sun)[:, None] * SUN_COLOR
    fresnel = np.where(glossy, (1 - np.clip((normals * to_eye).sum(axis=1), 0, 1)) ** 4, 0.0)
    return np.asarray(color + 0.06 * (fresnel * sky)[:, None] * SKY_COLOR)


def _leaf_albedo(scene: Scene, light: Light, leaf: NDArray[np.int32], uv: Array, below: NDArray[np.bool_]) -> Array:
    """Colours (K, 3): midrib and side veins paler, blotches, the lower side paler and greyer."""
    assert scene.leaves.color is not None
    color = scene.leaves.color[leaf]
    across, along = np.abs(uv[:, 0]), uv[:, 1]
    midrib = np.exp(-((across / (0.05 * (1.2 - along))) ** 2))
    phase = (along - 0.35 * across) * 9 + 0.5 * (uv[:, 0] > 0)
    to_vein = np.abs(phase - np.round(phase)) / 9  # in leaf lengths along the axis
    veins = np.exp(-((to_vein / 0.012) ** 2)) * np.clip(1.1 - across, 0, 1)
    place = light.leaf_noise[leaf] + uv * np.array([22.0, 44.0])
    blotches = _sample(light.noise, place)
    quilting = np.cos(2 * np.pi * phase)
    color = color * 2 ** (0.16 * blotches - 0.10 * quilting)[:, None]
    pale = np.clip(0.55 * midrib + 0.3 * veins, 0, 0.7)[:, None]
    color = color * (1 - pale) + pale * np.array([0.24, 0.32, 0.12])
    color[below] = 0.7 * color[below] + 0.3 * np.array([0.22, 0.28, 0.16])
    return np.asarray(color)


def _bark_albedo(bark: Bark, light: Light, points_m: Array, normals: Array) -> Array:
    """Colours (K, 3) of furrows, longer than wide, in the solid wood: seen along x and along z, as the bark faces."""
    x, y, z = (points_m / bark.grain_m).T
    facing = normals[:, 0] ** 2 / np.maximum(normals[:, 0] ** 2 + normals[:, 2] ** 2, 1e-12)
    rough = np.zeros(len(points_m))
    for finer, share in ((1.0, 0.8), (0.3, 0.6)):
        along_x = _sample(light.noise, np.column_stack([z + 0.37 * y, 0.45 * y]) * finer)
        along_z = _sample(light.noise, np.column_stack([x + 0.31 * y + 171.3, 0.45 * y]) * finer)
        rough += share * (np.sqrt(facing) * along_x + np.sqrt(1 - facing) * along_z)
    return np.asarray(np.array(bark.color) * 2 ** (bark.contrast * rough)[:, None])


def _backdrop(scene: Scene, light: Light, camera: Pinhole) -> Array:
    """Ground, wall and sky (H, W, 3)."""
    rays = camera.rays() @ camera.cam_from_world[:, :3]
    depth = backdrop_depth(scene, camera)
    seen = depth > 0
    image = np.tile(SKY_COLOR * 1.1, (*depth.shape, 1))
    points = camera.position_m + rays[seen] * depth[seen][:, None]
    on_wall = points[:, 1] > 1e-6 * light.length_m
    texel = light.length_m / 12
    flat = np.where(on_wall[:, None], points[:, [0, 1]], points[:, [0, 2]]) / texel
    fine, coarse = _sample(light.noise, flat * 3.1), _sample(light.noise, flat * 0.35)
    rough = 2 ** (np.where(on_wall, 0.05, 0.45) * fine + np.where(on_wall, 0.16, 0.2) * coarse)
    albedo = np.where(on_wall[:, None], PLASTER, SOIL) * rough[:, None]
    normals = np.where(on_wall[:, None], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0])
    place = ((points[:, [0, 2]] - light.ground_low) / light.ground_step).astype(np.float32)
    sky = _remap(light.ground_sky, place, cv2.BORDER_REPLICATE)
    sky = np.where(on_wall, 1.0, sky)
    direct = np.maximum(normals @ SUN, 0) * light.sun.lit(points)
    up = (0.5 + 0.5 * normals[:, 1]) * sky
    image[seen] = albedo * (direct[:, None] * SUN_COLOR + up[:, None] * SKY_COLOR + 0.04)
    return image


def backdrop_depth(scene: Scene, camera: Pinhole) -> Array:
    """Planar depth (H, W) of the ground and the wall, 0 where there is sky or the ground is far away."""
    rays = camera.rays() @ camera.cam_from_world[:, :3]
    position = camera.position_m
    with np.errstate(divide="ignore"):
        ground = np.where(rays[..., 1] < 0, -position[1] / rays[..., 1], np.inf)
        nearest = ground
        if scene.wall_z_m is not None:
            wall = np.where(rays[..., 2] < 0, (scene.wall_z_m - position[2]) / rays[..., 2], np.inf)
            nearest = np.minimum(ground, wall)
    return np.where(nearest < FAR * scene.leaves.length_m.mean(), nearest, 0.0)


def _shadow_map(scene: Scene, towards: Array, texels_a_leaf: float, max_texels: int, length_m: float) -> ShadowMap:
    across = np.cross([0.0, 0.0, 1.0] if abs(towards[2]) < 0.9 else [1.0, 0.0, 0.0], towards)
    across /= np.linalg.norm(across)
    axes = np.stack([across, np.cross(towards, across), towards])
    place = scene.points_m @ axes.T
    low, high = place.min(axis=0), place.max(axis=0)
    texel_m = max(length_m / texels_a_leaf, float((high - low)[:2].max()) / max_texels)
    columns, rows = (np.ceil((high - low)[:2] / texel_m).astype(int) + 1).tolist()
    # The buffer keeps what is greatest and above 0: the height over the lowest.
    hits = rasterise(
        (place[:, :2] - low[:2]) / texel_m, place[:, 2] - low[2] + texel_m, scene.triangles, (rows, columns)
    )
    height = np.full(hits.depth.shape, -np.inf, np.float32)
    met = hits.triangle >= 0
    height[met] = 1 / hits.depth[met] + low[2] - texel_m
    return ShadowMap(
        light_from_world=axes, origin=low[:2], texel_m=texel_m, height=height, bias_m=max(2 * texel_m, 0.03 * length_m)
    )


def _sky_directions(count: int) -> Array:
    """Unit vectors (count, 3) over the upper half, as even as a spiral is, denser overhead."""
    k = np.arange(count) + 0.5
    height = np.sqrt(1 - k / count * 0.95)
    turn = np.pi * (3 - 5**0.5) * k
    level = np.sqrt(1 - height**2)
    return np.column_stack([level * np.cos(turn), height, level * np.sin(turn)])


def _periodic_noise(rng: np.random.Generator) -> NDArray[np.float32]:
    """Noise whose power falls with frequency, from its spectrum."""
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(NOISE_SIZE), np.fft.fftfreq(NOISE_SIZE)))
    spectrum = np.fft.fft2(rng.normal(size=(NOISE_SIZE, NOISE_SIZE))) / np.maximum(frequency, 4 / NOISE_SIZE) ** 1.1
    noise = np.fft.ifft2(spectrum).real
    return np.asarray((noise - noise.mean()) / noise.std(), np.float32)


def _sample(noise: NDArray[np.float32], places: Array) -> Array:
    """Values (K,) at places (K, 2), x and y, in texels; periodic."""
    tiled = np.pad(noise, (0, 1), mode="wrap")
    return _remap(tiled, np.mod(places, NOISE_SIZE).astype(np.float32), cv2.BORDER_REPLICATE)


def _remap(image: NDArray[np.float32], places: NDArray[np.float32], border: int) -> Array:
    values = np.empty(len(places))
    rows = 1 << 14  # pictures in OpenCV have fewer than 2^15 rows
    for begin in range(0, len(places), rows):
        part = places[begin : begin + rows]
        values[begin : begin + rows] = cv2.remap(
            image, part[:, None, :], None, cv2.INTER_LINEAR, borderMode=border
        ).ravel()
    return values
