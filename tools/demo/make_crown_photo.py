"""Make the photograph that `make demo` starts from: a dense tree of our own growing, rendered by Cycles, and its mask.

usage: .venv-preview/bin/python tools/demo/make_crown_photo.py [FOLDER]     writes crown.jpg and crown_mask.png
"""

import math
import sys
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]  # (N, 3), metres, Z up

SEED = 20
WIDTH_PX, HEIGHT_PX = 900, 1000
SAMPLES = 40
JPEG_QUALITY = 82

CROWN_CENTER_M = np.array([0.05, 0.0, 4.55])
CROWN_RADII_M = np.array([2.55, 2.35, 2.35])
LOBES = 38
SPRAYS_PER_LOBE = 62
LEAVES_PER_SPRAY = 62
FILL_LEAVES = 36_000  # in the shade inside, so that no sky shows through
GROUND_M = 0.0

CAMERA_DISTANCE_M = 24.0
CAMERA_HEIGHT_M = 1.7
PICTURE_HEIGHT_M = 9.6  # at the distance of the trunk
PICTURE_BOTTOM_M = -0.8


def unit(vectors: Points) -> Points:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)


def fibonacci_sphere(count: int) -> Points:
    """Evenly spread unit vectors, (count, 3)."""
    k = np.arange(count) + 0.5
    z = 1 - 2 * k / count
    turn = math.pi * (1 + math.sqrt(5)) * k
    return np.column_stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z])


@dataclass(frozen=True, kw_only=True, eq=False)
class Foliage:
    """Where leaves stand: one row each."""

    base_m: Points
    axis: Points  # unit, from base to apex
    normal: Points  # unit, of the upper side
    length_m: NDArray[np.float64]
    color: Points  # linear


def build_leaf_mesh(name: str, foliage: Foliage, rng: np.random.Generator, width: float = 0.52) -> bpy.types.Object:
    """One mesh of all leaves; a leaf is eight points: folded along its midrib, arched, pointed."""
    count = len(foliage.base_m)
    side = unit(np.cross(foliage.normal, foliage.axis))
    up = np.cross(foliage.axis, side)
    # Along, across, up in leaf lengths: base, two cross-sections (left, midrib, right), apex.
    stem, apex = (0, 0, 0), (1, 0, -0.22)
    lower, upper = (
        [(0.3, -0.46, 0.1), (0.3, 0, 0.0), (0.3, 0.46, 0.1)],
        [(0.68, -0.34, 0.02), (0.68, 0, -0.06), (0.68, 0.34, 0.02)],
    )
    template = np.array([stem, *lower, *upper, apex])
    template = np.broadcast_to(template, (count, 8, 3)).copy()
    template[..., 1] *= width * rng.uniform(0.8, 1.2, (count, 1))
    template[..., 2] *= rng.uniform(0.4, 1.6, (count, 1))
    local = template * foliage.length_m[:, None, None]
    frame = np.stack([foliage.axis, side, up], axis=1)
    points = foliage.base_m[:, None, :] + local @ frame
    triangles = np.array(
        [(0, 2, 1), (0, 3, 2), (1, 2, 5), (1, 5, 4), (2, 3, 6), (2, 6, 5), (4, 5, 7), (5, 6, 7)], np.int32
    )
    faces = triangles[None] + 8 * np.arange(count, dtype=np.int32)[:, None, None]
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(count * 8)
    mesh.vertices.foreach_set("co", points.astype(np.float32).ravel())
    mesh.loops.add(faces.size)
    mesh.loops.foreach_set("vertex_index", faces.ravel())
    mesh.polygons.add(faces.size // 3)
    mesh.polygons.foreach_set("loop_start", np.arange(0, faces.size, 3, dtype=np.int32))
    mesh.update(calc_edges=True)
    attribute = mesh.attributes.new("leaf_color", "FLOAT_COLOR", "POINT")
    rgba = np.ones((count, 8, 4), np.float32)
    rgba[..., :3] = foliage.color[:, None, :]
    attribute.data.foreach_set("color", rgba.ravel())
    mesh.polygons.foreach_set("use_smooth", np.ones(len(mesh.polygons), bool))
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.collection.objects.link(thing)
    return thing


def grow_crown(rng: np.random.Generator) -> tuple[Foliage, Points]:
    """Leaves in sprays on the outside of lobes that stand on an ellipsoid; returns them and the lobes' middles."""
    direction = unit(fibonacci_sphere(LOBES) + rng.normal(0, 0.16, (LOBES, 3)))
    # An old tree is not round: flat below, shoulders to one side, a top off the middle.
    swell = 1 + 0.10 * np.sin(2.3 * direction[:, 0] + 0.7) + 0.07 * np.sin(3.1 * direction[:, 2] + 1.9)
    swell *= np.where(direction[:, 2] < -0.35, 0.86, 1.0)
    lobe_radius = rng.uniform(0.55, 1.08, LOBES)
    lobe_middle = CROWN_CENTER_M + direction * (CROWN_RADII_M * swell[:, None]) * rng.uniform(0.8, 1.02, (LOBES, 1))
    lobe_tone = rng.normal(0, 0.16, LOBES)

    lobe = np.repeat(np.arange(LOBES), SPRAYS_PER_LOBE)
    toward = unit(rng.normal(size=(len(lobe), 3)) + 0.9 * direction[lobe] + np.array([0, 0, 0.25]))
    depth = 1 - 0.38 * rng.random(len(lobe)) ** 1.6
    spray_m = lobe_middle[lobe] + toward * (lobe_radius[lobe] * depth)[:, None] * np.array([1.08, 1.08, 0.9])
    spray_out = unit(toward + 0.35 * rng.normal(size=toward.shape) + np.array([0, 0, -0.15]))
    spray_tone = lobe_tone[lobe] + rng.normal(0, 0.12, len(lobe))

    spray = np.repeat(np.arange(len(lobe)), LEAVES_PER_SPRAY)
    along = rng.uniform(-0.12, 0.34, len(spray))
    scatter = np.clip(rng.normal(0, 0.095, (len(spray), 3)), -0.2, 0.2)
    base_m = spray_m[spray] + spray_out[spray] * along[:, None] + scatter
    base_m[:, 2] -= 0.25 * np.maximum(along, 0) ** 1.5  # twigs hang a little at their ends
    axis = unit(0.9 * spray_out[spray] + 0.75 * rng.normal(size=base_m.shape) + np.array([0, 0, -0.35]))
    outward = unit(base_m - CROWN_CENTER_M)
    facing = unit(0.7 * outward + np.array([0, 0, 0.75]) + 0.55 * rng.normal(size=base_m.shape))
    normal = unit(facing - axis * np.sum(facing * axis, axis=1, keepdims=True))

    tone = np.exp(spray_tone[spray] + rng.normal(0, 0.16, len(spray)))
    yellow = np.clip(rng.beta(1.4, 4.5, len(spray)) + 0.5 * spray_tone[spray], 0, 1)[:, None]
    color = (1 - yellow) * np.array([0.052, 0.125, 0.022]) + yellow * np.array([0.175, 0.235, 0.036])
    color = np.clip(color * tone[:, None], 0.005, 0.6)

    inside = CROWN_CENTER_M + unit(rng.normal(size=(FILL_LEAVES, 3))) * CROWN_RADII_M * rng.uniform(
        0.3, 0.9, (FILL_LEAVES, 1)
    )
    random_axis = unit(rng.normal(size=inside.shape))
    base_m = np.concatenate([base_m, inside])
    axis = np.concatenate([axis, random_axis])
    normal = np.concatenate([normal, unit(np.cross(random_axis, rng.normal(size=inside.shape)))])
    color = np.concatenate([color, np.broadcast_to([0.04, 0.09, 0.018], inside.shape)])
    length_m = rng.uniform(0.06, 0.115, len(base_m))
    kept = base_m[:, 2] > 1.5
    foliage = Foliage(
        base_m=base_m[kept], axis=axis[kept], normal=normal[kept], length_m=length_m[kept], color=color[kept]
    )
    return foliage, lobe_middle


def grow_treeline(rng: np.random.Generator) -> Foliage:
    """A hazy wood far behind, of large cards."""
    trees = 70
    middle = np.column_stack(
        [
            np.linspace(-62, 62, trees) + rng.normal(0, 1.5, trees),
            rng.uniform(120, 165, trees),
            rng.uniform(1, 3.4, trees),
        ]
    )
    radius = rng.uniform(2.8, 6.4, trees)
    tree = np.repeat(np.arange(trees), 3600)
    out = unit(rng.normal(size=(len(tree), 3)))
    base_m = middle[tree] + out * (radius[tree] * rng.uniform(0.75, 1.0, len(tree)))[:, None] * np.array([1, 0.6, 1.15])
    axis = unit(rng.normal(size=base_m.shape))
    normal = unit(np.cross(axis, unit(np.cross(out + np.array([0, 0, 0.8]), axis))))
    haze = np.array([0.27, 0.32, 0.33])
    green = np.array([0.05, 0.085, 0.03]) * rng.uniform(0.6, 1.5, trees)[tree][:, None]
    color = 0.76 * green + 0.24 * haze
    return Foliage(base_m=base_m, axis=axis, normal=normal, length_m=rng.uniform(0.22, 0.5, len(tree)), color=color)


def grow_grass(rng: np.random.Generator) -> Foliage:
    """Blades of a lawn that was not mown for a fortnight, as narrow leaves standing up."""
    count = 190_000
    y = -12 + 92 * rng.random(count) ** 1.9
    x = rng.uniform(-0.26, 0.26, count) * (y + CAMERA_DISTANCE_M)
    base_m = np.column_stack([x, y, np.full(count, GROUND_M)])
    patch = 0.5 + 0.5 * np.sin(1.7 * x + 2 * np.sin(0.9 * y)) * np.sin(1.1 * y + 1.3)
    axis = unit(np.array([0, 0, 1.0]) + 0.55 * rng.normal(size=base_m.shape))
    facing = unit(rng.normal(size=base_m.shape))
    normal = unit(np.cross(axis, unit(np.cross(facing, axis))))
    dry = np.clip(rng.beta(1.2, 4, count) + 0.25 * (patch - 0.4), 0, 1)[:, None]
    color = (1 - dry) * np.array([0.055, 0.12, 0.022]) + dry * np.array([0.22, 0.21, 0.075])
    length_m = rng.uniform(0.05, 0.15, count) * (0.7 + 0.6 * patch)
    return Foliage(base_m=base_m, axis=axis, normal=normal, length_m=length_m, color=color)


def build_wood(lobe_middle: Points, rng: np.random.Generator) -> bpy.types.Object:
    """Trunk and limbs: curves with a bevel, the limbs from the trunk's fork to the lobes."""
    curve = bpy.data.curves.new("wood", "CURVE")
    curve.dimensions, curve.bevel_depth, curve.bevel_resolution = "3D", 1.0, 5

    def add(points: Points, radii: NDArray[np.float64]) -> None:
        spline = curve.splines.new("POLY")
        spline.points.add(len(points) - 1)
        spline.points.foreach_set("co", np.column_stack([points, np.ones(len(points))]).ravel())
        spline.points.foreach_set("radius", radii)

    t = np.linspace(0, 1, 24)[:, None]
    fork = np.array([0.05, 0.05, 2.6])
    trunk = t * fork + np.sin(math.pi * t) * np.array([0.07, 0, 0]) + np.array([0.0, 0, -0.1])
    flare = 0.16 * np.exp(-t[:, 0] * 14)
    add(trunk, 0.23 - 0.05 * t[:, 0] + flare)
    for tip in lobe_middle:
        bend = rng.normal(0, 0.18, 3) + np.array([0, 0, 0.35])
        limb = (1 - t) * fork + t * tip + np.sin(math.pi * t) * bend
        add(limb, 0.11 * (1 - 0.85 * t[:, 0]))
    thing = bpy.data.objects.new("wood", curve)
    bpy.context.collection.objects.link(thing)
    return thing


def build_ground() -> bpy.types.Object:
    size = 400.0
    mesh = bpy.data.meshes.new("ground")
    mesh.from_pydata([(-size, -60, 0), (size, -60, 0), (size, size, 0), (-size, size, 0)], [], [(0, 1, 2, 3)])
    thing = bpy.data.objects.new("ground", mesh)
    bpy.context.collection.objects.link(thing)
    return thing


def leaf_material(name: str, translucency: float, gloss: float) -> bpy.types.Material:
    """Diffuse above, light shining through from behind, a thin waxy reflection."""
    material = bpy.data.materials.new(name)
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    color = nodes.new("ShaderNodeAttribute")
    color.attribute_name = "leaf_color"
    diffuse, through, wax = (nodes.new(f"ShaderNodeBsdf{kind}") for kind in ("Diffuse", "Translucent", "Glossy"))
    wax.inputs["Roughness"].default_value = 0.42
    wax.inputs["Color"].default_value = (0.9, 0.95, 1.0, 1.0)
    warm = nodes.new("ShaderNodeMix")
    warm.data_type, warm.blend_type = "RGBA", "MULTIPLY"
    warm.inputs[0].default_value = 1.0
    warm.inputs[7].default_value = (1.5, 1.35, 0.6, 1.0)  # light that came through a leaf is yellower
    matte, coated, output = (
        nodes.new("ShaderNodeMixShader"),
        nodes.new("ShaderNodeMixShader"),
        nodes.new("ShaderNodeOutputMaterial"),
    )
    links.new(color.outputs["Color"], diffuse.inputs["Color"])
    links.new(color.outputs["Color"], warm.inputs[6])
    links.new(warm.outputs[2], through.inputs["Color"])
    matte.inputs[0].default_value = translucency
    coated.inputs[0].default_value = gloss
    links.new(diffuse.outputs[0], matte.inputs[1])
    links.new(through.outputs[0], matte.inputs[2])
    links.new(matte.outputs[0], coated.inputs[1])
    links.new(wax.outputs[0], coated.inputs[2])
    links.new(coated.outputs[0], output.inputs["Surface"])
    return material


def noise_material(name: str, dark: Points, light: Points, scale: float, stretch: Points) -> bpy.types.Material:
    """A matte surface of two colours mixed by noise: bark, soil between grass."""
    material = bpy.data.materials.new(name)
    nodes, links = material.node_tree.nodes, material.node_tree.links
    surface = nodes["Principled BSDF"]
    surface.inputs["Roughness"].default_value = 0.95
    surface.inputs["Specular IOR Level"].default_value = 0.1
    place, mapping = nodes.new("ShaderNodeTexCoord"), nodes.new("ShaderNodeMapping")
    mapping.inputs["Scale"].default_value = stretch
    noise, ramp, bump = nodes.new("ShaderNodeTexNoise"), nodes.new("ShaderNodeValToRGB"), nodes.new("ShaderNodeBump")
    noise.inputs["Scale"].default_value = scale
    noise.inputs["Detail"].default_value = 9.0
    ramp.color_ramp.elements[0].position, ramp.color_ramp.elements[1].position = 0.35, 0.68
    ramp.color_ramp.elements[0].color = (*dark, 1)
    ramp.color_ramp.elements[1].color = (*light, 1)
    bump.inputs["Strength"].default_value = 0.6
    links.new(place.outputs["Object"], mapping.inputs["Vector"])
    links.new(mapping.outputs["Vector"], noise.inputs["Vector"])
    links.new(noise.outputs["Fac"], ramp.inputs["Fac"])
    links.new(ramp.outputs["Color"], surface.inputs["Base Color"])
    links.new(noise.outputs["Fac"], bump.inputs["Height"])
    links.new(bump.outputs["Normal"], surface.inputs["Normal"])
    return material


def build_sky() -> None:
    """Thin high cloud: white at the horizon, pale blue above, so even that shadows stay soft."""
    world = bpy.data.worlds.new("sky")
    bpy.context.scene.world = world
    nodes, links = world.node_tree.nodes, world.node_tree.links
    place, split = nodes.new("ShaderNodeTexCoord"), nodes.new("ShaderNodeSeparateXYZ")
    height = nodes.new("ShaderNodeValToRGB")
    height.color_ramp.elements[0].color = (0.80, 0.86, 0.92, 1)
    height.color_ramp.elements[1].color = (0.27, 0.46, 0.78, 1)
    height.color_ramp.elements[1].position = 0.62
    stretch, cloud, veil = (
        nodes.new("ShaderNodeMapping"),
        nodes.new("ShaderNodeTexNoise"),
        nodes.new("ShaderNodeValToRGB"),
    )
    stretch.inputs["Scale"].default_value = (1.4, 1.4, 5.0)
    stretch.inputs["Location"].default_value = (0.3, 1.7, 0.4)
    cloud.inputs["Scale"].default_value = 2.3
    cloud.inputs["Detail"].default_value = 7.0
    cloud.inputs["Roughness"].default_value = 0.56
    veil.color_ramp.elements[0].position, veil.color_ramp.elements[1].position = 0.40, 0.72
    mix, background = nodes.new("ShaderNodeMix"), nodes["Background"]
    mix.data_type = "RGBA"
    mix.inputs[7].default_value = (0.95, 0.96, 0.98, 1)
    links.new(place.outputs["Generated"], split.inputs[0])
    links.new(split.outputs["Z"], height.inputs["Fac"])
    links.new(place.outputs["Generated"], stretch.inputs["Vector"])
    links.new(stretch.outputs["Vector"], cloud.inputs["Vector"])
    links.new(cloud.outputs["Fac"], veil.inputs["Fac"])
    links.new(veil.outputs["Color"], mix.inputs[0])
    links.new(height.outputs["Color"], mix.inputs[6])
    links.new(mix.outputs[2], background.inputs["Color"])
    background.inputs["Strength"].default_value = 1.0


def build_sun() -> None:
    light = bpy.data.lights.new("sun", "SUN")
    light.energy, light.angle, light.color = 4.2, math.radians(7.0), (1.0, 0.93, 0.80)
    thing = bpy.data.objects.new("sun", light)
    thing.rotation_euler = (math.radians(48), 0, math.radians(-38))  # over the photographer's left shoulder
    bpy.context.collection.objects.link(thing)


def build_camera() -> None:
    """A level camera whose picture is shifted upwards, so that the trunk stands straight."""
    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit, camera.sensor_height = "VERTICAL", 24.0
    camera.lens = 24.0 * CAMERA_DISTANCE_M / PICTURE_HEIGHT_M
    camera.shift_y = (PICTURE_BOTTOM_M + PICTURE_HEIGHT_M / 2 - CAMERA_HEIGHT_M) / PICTURE_HEIGHT_M
    thing = bpy.data.objects.new("camera", camera)
    thing.location = (0, -CAMERA_DISTANCE_M, CAMERA_HEIGHT_M)
    thing.rotation_euler = (math.pi / 2, 0, 0)
    bpy.context.collection.objects.link(thing)
    bpy.context.scene.camera = thing


def build_scene() -> bpy.types.Object:
    """The whole scene; returns the crown's leaves."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    rng = np.random.default_rng(SEED)
    foliage, lobe_middle = grow_crown(rng)
    crown = build_leaf_mesh("crown", foliage, rng)
    crown.data.materials.append(leaf_material("leaf", translucency=0.30, gloss=0.05))
    wood = build_wood(lobe_middle, rng)
    wood.data.materials.append(noise_material("bark", (0.028, 0.022, 0.017), (0.16, 0.13, 0.10), 9.0, (2.2, 2.2, 0.45)))
    treeline = build_leaf_mesh("treeline", grow_treeline(rng), rng, width=0.9)
    treeline.data.materials.append(leaf_material("far leaf", translucency=0.1, gloss=0.0))
    grass = build_leaf_mesh("grass", grow_grass(rng), rng, width=0.1)
    grass.data.materials.append(leaf_material("blade", translucency=0.25, gloss=0.03))
    ground = build_ground()
    ground.data.materials.append(noise_material("soil", (0.035, 0.06, 0.018), (0.11, 0.14, 0.045), 1.3, (1, 1, 1)))
    build_sky()
    build_sun()
    build_camera()
    return crown


def configure_cycles() -> None:
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.seed = SEED
    scene.cycles.samples = SAMPLES
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.use_denoising = False  # what noise is left is a camera's grain; a denoiser paints leaves smooth
    scene.cycles.max_bounces, scene.cycles.diffuse_bounces, scene.cycles.transmission_bounces = 6, 4, 4
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = WIDTH_PX, HEIGHT_PX, 100
    scene.view_settings.view_transform = "AgX"
    scene.view_settings.look = "AgX - Medium High Contrast"
    scene.view_settings.exposure = 0.75


def render_photo(path: Path) -> None:
    scene = bpy.context.scene
    scene.render.image_settings.file_format = "JPEG"
    scene.render.image_settings.color_mode = "RGB"
    scene.render.image_settings.quality = JPEG_QUALITY
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


def render_coverage(crown: bpy.types.Object, path: Path) -> NDArray[np.float64]:
    """How much of each pixel the crown's leaves cover, seen past whatever stands before them; row 0 is the top."""
    scene = bpy.context.scene
    for thing in scene.objects:
        thing.hide_render = thing.type in {"MESH", "CURVE"} and thing is not crown
    scene.render.film_transparent = True
    scene.cycles.samples = 8
    scene.cycles.max_bounces = 0
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGBA"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(path))
    pixels = np.empty(WIDTH_PX * HEIGHT_PX * 4, np.float32)
    image.pixels.foreach_get(pixels)
    path.unlink()
    return pixels.reshape(HEIGHT_PX, WIDTH_PX, 4)[::-1, :, 3].astype(np.float64)


def grow(mask: NDArray[np.bool_], steps: int) -> NDArray[np.bool_]:
    """The mask grown by discs of the given radius in pixels."""
    out = mask.copy()
    for dy in range(-steps, steps + 1):
        for dx in range(-steps, steps + 1):
            if dx * dx + dy * dy <= steps * steps:
                out |= np.roll(mask, (dy, dx), axis=(0, 1))
    return out


def fill_crown(coverage: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Leaves, the small gaps between them and every hole inside, as one shape."""
    leaves = coverage > 0.5
    closed = ~grow(~grow(leaves, 2), 2)
    border = np.zeros_like(closed)
    border[0] = border[-1] = border[:, 0] = border[:, -1] = True
    filled = ~flood(border, ~closed)
    opened = grow(~grow(~filled, 4), 4)  # single leaves that stand off would bring more sky than leaf
    middle = np.zeros_like(opened)
    middle[HEIGHT_PX * 2 // 5, WIDTH_PX // 2] = True
    return flood(middle, opened)


def flood(start: NDArray[np.bool_], within: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """What of a mask hangs together with the start, by edges of pixels."""
    reached = start & within
    while True:
        grown = grow(reached, 1) & within
        if (grown == reached).all():
            return reached
        reached = grown


def write_mask(mask: NDArray[np.bool_], path: Path) -> None:
    rows = np.repeat(mask[::-1, :, None], 4, axis=2).astype(np.float32)
    rows[..., 3] = 1.0
    image = bpy.data.images.new("mask", WIDTH_PX, HEIGHT_PX, alpha=False)
    image.colorspace_settings.name = "Non-Color"
    image.pixels.foreach_set(rows.ravel())
    settings = bpy.context.scene.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth, settings.compression = "PNG", "BW", "8", 100
    bpy.context.scene.view_settings.view_transform = "Raw"
    bpy.context.scene.view_settings.look = "None"
    image.save_render(str(path))


def main(folder: Path) -> None:
    crown = build_scene()
    configure_cycles()
    render_photo(folder / "crown.jpg")
    mask = fill_crown(render_coverage(crown, folder / "coverage.png"))
    write_mask(mask, folder / "crown_mask.png")
    rows, columns = np.nonzero(mask)
    print(
        f"{len(crown.data.polygons) // 8} leaves; mask {mask.mean():.1%} of the picture, "
        f"columns {columns.min()} to {columns.max()} of {WIDTH_PX}, rows {rows.min()} to {rows.max()} of {HEIGHT_PX}"
    )
    if rows.min() < 2 or columns.min() < 2 or rows.max() > HEIGHT_PX - 3 or columns.max() > WIDTH_PX - 3:
        raise SystemExit("error: the crown touches the border of the picture")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parent)
