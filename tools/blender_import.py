"""Open a USD asset in Blender, as an artist would, and print what arrived there as one line of JSON.

usage: .venv-preview/bin/python tools/blender_import.py ASSET.usda [--render PNG] [--albedo EXR] [--size W H] ...

Runs in an interpreter that has `bpy`. Bounds are printed in Blender's frame (Z up, as it shows them) and in the asset's
(Y up, metres). --render draws the front with Cycles under an even white sky, so that colours come out as they are;
--albedo writes the colour of the surfaces there alone, linear, as Cycles' pass of the diffuse colour.
"""

import argparse
import json
import math
import sys
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector


def import_asset(path: Path) -> None:
    """Read the file into an empty scene, textures where they lie or out of a package, subdivision surfaces as such."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    textures = "IMPORT_PACK" if path.suffix == ".usdz" else "IMPORT_NONE"
    done = bpy.ops.wm.usd_import(filepath=str(path), import_textures_mode=textures, import_subdivision=True)
    if done != {"FINISHED"}:
        raise SystemExit(f"error: Blender cannot import it ({path})")


def mesh_points(mesh: bpy.types.Mesh) -> np.ndarray:
    """Vertices of a mesh, (N, 3)."""
    points = np.empty(len(mesh.vertices) * 3)
    mesh.vertices.foreach_get("co", points)
    return points.reshape(-1, 3)


def drawn_meshes() -> list[tuple[bool, np.ndarray, np.ndarray]]:
    """What Blender draws: for each mesh whether it is an instance, its points (N, 3) and its world matrix (4, 4)."""
    meshes = []
    for thing in bpy.context.evaluated_depsgraph_get().object_instances:
        if thing.object.type == "MESH":
            # Before subdivision: the control mesh is what the file holds.
            mesh = thing.object.original.data
            meshes.append((thing.is_instance, mesh_points(mesh), np.array(thing.matrix_world)))
    return meshes


def count_islands(mesh: bpy.types.Mesh) -> int:
    """Parts of a mesh that no edge joins: leaves, in a mesh of leaves."""
    edges = np.empty(2 * len(mesh.edges), np.int32)
    mesh.edges.foreach_get("vertices", edges)
    first, second = edges.reshape(-1, 2).T
    label = np.arange(len(mesh.vertices))
    while True:
        smaller = np.minimum(label[first], label[second])
        new = label.copy()
        np.minimum.at(new, first, smaller)
        np.minimum.at(new, second, smaller)
        new = new[new]
        if np.array_equal(new, label):
            return len(np.unique(label))
        label = new


def describe_object(thing: bpy.types.Object) -> dict:
    described = {"name": thing.name, "type": thing.type}
    if thing.type == "MESH":
        described["vertices"] = len(thing.data.vertices)
        described["faces"] = len(thing.data.polygons)
        described["islands"] = count_islands(thing.data)
        described["subdivided"] = any(modifier.type == "SUBSURF" for modifier in thing.modifiers)
        described["uv_maps"] = [layer.name for layer in thing.data.uv_layers]
        described["materials"] = [slot.material.name for slot in thing.material_slots if slot.material]
    return described


def describe_image(image: bpy.types.Image) -> dict:
    path = Path(bpy.path.abspath(image.filepath))
    return {
        "name": image.name,
        "file": str(path),
        # Out of a package it is packed, or in a temporary folder; reading the size loads the file.
        "found": (path.is_file() or image.packed_file is not None) and image.size[0] > 0,
        "size": list(image.size),
        "color_space": image.colorspace_settings.name,
    }


def describe_scene() -> dict:
    """Objects, materials, images and bounds of what was imported."""
    meshes = [thing for thing in bpy.data.objects if thing.type == "MESH"]
    found = {
        "blender": bpy.app.version_string,
        "objects": [describe_object(thing) for thing in sorted(bpy.data.objects, key=lambda thing: thing.name)],
        "meshes": len(meshes),
        "materials": sorted(material.name for material in bpy.data.materials if material.users),
        "images": [describe_image(image) for image in bpy.data.images if image.source == "FILE"],
    }
    meshes = drawn_meshes()
    found["instances"] = sum(is_instance for is_instance, _, _ in meshes)
    if meshes:
        points = np.concatenate([points @ matrix[:3, :3].T + matrix[:3, 3] for _, points, matrix in meshes])
        x, y, z = points.T
        in_asset = np.column_stack([x, z, -y])  # Blender stands Y-up stages up by a quarter turn about x
        found["bound_blender"] = [points.min(axis=0).tolist(), points.max(axis=0).tolist()]
        found["bound_asset"] = [in_asset.min(axis=0).tolist(), in_asset.max(axis=0).tolist()]
    return found


def set_up_front(bound: list[list[float]], size_px: tuple[int, int], samples: int) -> None:
    """Put a camera before the asset, without perspective, for Cycles on a transparent ground."""
    low, high = Vector(bound[0]), Vector(bound[1])
    middle, extent = (low + high) / 2, high - low
    scene = bpy.context.scene
    camera = bpy.data.cameras.new("front")
    camera.type = "ORTHO"
    width_px, height_px = size_px
    camera.sensor_fit = "HORIZONTAL"
    camera.ortho_scale = 1.1 * max(extent.x, extent.z * width_px / height_px)
    camera.clip_end = 10 * extent.length + 10
    stand = bpy.data.objects.new("front", camera)
    stand.location = (middle.x, low.y - extent.length, middle.z)
    stand.rotation_euler = (math.pi / 2, 0, 0)
    scene.collection.objects.link(stand)
    scene.camera = stand

    world = bpy.data.worlds.new("white")
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (1, 1, 1, 1)
    scene.world = world

    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.seed = "CPU", samples, 0
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    scene.cycles.max_bounces = 2
    scene.render.film_transparent = True
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = width_px, height_px, 100
    scene.view_settings.view_transform = "Standard"


def render_front(output: Path) -> None:
    """Draw the front as it is displayed."""
    scene = bpy.context.scene
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "PNG", "RGBA", "8"
    scene.render.filepath = str(output)
    bpy.ops.render.render(write_still=True)


def render_albedo(output: Path) -> None:
    """Write the diffuse colour of what the front shows."""
    scene = bpy.context.scene
    (layer,) = scene.view_layers
    layer.use_pass_diffuse_color = True
    layer.use_pass_combined = False
    settings = scene.render.image_settings
    settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format, settings.color_depth = "OPEN_EXR_MULTILAYER", "32"
    scene.render.filepath = str(output)
    bpy.ops.render.render(write_still=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("asset", type=Path)
    parser.add_argument("--render", metavar="PNG", type=Path)
    parser.add_argument("--albedo", metavar="EXR", type=Path)
    parser.add_argument("--size", metavar=("W", "H"), type=int, nargs=2, default=(256, 256))
    parser.add_argument("--samples", type=int, default=8)
    options = parser.parse_args()
    if not options.asset.is_file():
        raise SystemExit(f"error: no such file ({options.asset})")
    import_asset(options.asset.resolve())
    found = describe_scene()
    if options.render is not None or options.albedo is not None:
        if "bound_blender" not in found:
            raise SystemExit(f"error: Blender imported no mesh to draw ({options.asset})")
        set_up_front(found["bound_blender"], tuple(options.size), options.samples)
    if options.render is not None:
        render_front(options.render.resolve())
    if options.albedo is not None:
        render_albedo(options.albedo.resolve())
    sys.stdout.flush()
    print("\n" + json.dumps(found))


if __name__ == "__main__":
    main()
