"""Draw views of a USD file in Hydra Storm: record.py REQUEST.json RESULT.json, in an interpreter that has USD imaging.

The request and the result are described in README.md. Nothing of usdfoliage is imported: the product lives in another
interpreter, whose `pxr` cannot share a process with this one's. Progress goes to stdout, `usdfoliage-frame DONE TOTAL`.
"""

import importlib.util
import json
import math
import os
import sys
from pathlib import Path
from typing import NamedTuple

# How far a shader may displace what an instancer repeats: a part of its size, and so many times how far the instancer's
# extent reaches beyond what is not displaced, for along a slant less of a displacement shows.
GROWTH = 0.25
EXCESSES = 2.0
MANY_PRIMS = 200  # that are measured by their points; of more, by their boxes
SAMPLES = 4  # of a pixel, where the request names none: Storm's own


class RecordError(Exception):
    """Why nothing could be drawn; the product chooses its advice by kind."""

    def __init__(self, kind: str, message: str) -> None:
        super().__init__(message)
        self.kind = kind


class LargerPictures(Exception):
    """They shall be drawn larger, with one sample of a pixel, which is chosen before USD is loaded."""

    def __init__(self, scale: int) -> None:
        super().__init__(f"by {scale}")
        self.scale = scale


def load_usd() -> str:
    """Make `pxr` with imaging importable, from Blender's wheel where that is installed; returns its version."""
    specification = importlib.util.find_spec("bpy")
    try:
        if specification is not None and specification.origin is not None:
            import bpy  # noqa: F401  its import loads the libraries that pxr links

            packages = Path(specification.origin).parent.glob("[0-9]*/python/lib/python3*/site-packages")
            sys.path.extend(str(folder) for folder in packages)
        from pxr import Usd, UsdAppUtils, UsdImagingGL  # noqa: F401
    except ModuleNotFoundError as error:
        raise RecordError("usd", str(error)) from error
    except ImportError as error:  # a shared library that does not load
        raise RecordError("library", str(error)) from error
    return ".".join(str(n) for n in Usd.GetVersion()[1:])


def message_of(error: Exception) -> str:
    """The messages of USD's errors in one line, without their C++ functions and source files."""
    lines = str(error).splitlines()
    messages = [line.split(" : ", 1)[1].strip().strip("'") for line in lines if " : " in line]
    return "; ".join(dict.fromkeys(messages)) or " ".join(str(error).split())


def open_stage(path: str, muted: list[str]):
    """The stage of a file with everything loaded, editable in its session layer only.

    Layers are muted by their paths.
    """
    from pxr import Tf, Usd

    try:
        stage = Usd.Stage.Open(path, Usd.Stage.LoadAll)
    except Tf.ErrorException as error:
        raise RecordError("file", message_of(error)) from error
    stage.SetEditTarget(stage.GetSessionLayer())
    for layer in muted:
        stage.MuteLayer(layer)
    return stage


def select_variant(stage, name: str, chosen: str) -> None:
    """Select a variant in the session layer on every prim that has the set."""
    known: set[str] = set()
    # A selection may bring prims, so none is kept while others are made.
    for path in [prim.GetPath() for prim in stage.Traverse() if name in prim.GetVariantSets().GetNames()]:
        variant_set = stage.GetPrimAtPath(path).GetVariantSet(name)
        known.update(variant_set.GetVariantNames())
        if chosen in variant_set.GetVariantNames():
            variant_set.SetVariantSelection(chosen)
    if chosen not in known:
        there = f"there are {', '.join(sorted(known))}" if known else "no prim has such a variant set"
        raise RecordError("variant", f"no variant {name}={chosen}; {there}")


def compute_bound(stage, time, purposes: list[str]):
    """The world bound of what the purposes show, as an aligned Gf.Range3d of a size above zero."""
    from pxr import UsdGeom

    def bound_of(wanted):
        # extentsHint may be wider than what is drawn, or stale: measure.
        cache = UsdGeom.BBoxCache(time, wanted, useExtentsHint=False)
        return cache.ComputeWorldBound(stage.GetPseudoRoot()).ComputeAlignedRange()

    bound = bound_of(purposes)
    if bound.IsEmpty():
        hidden = [
            p for p in ("default", "render", "proxy", "guide") if p not in purposes and not bound_of([p]).IsEmpty()
        ]
        found = f"; it has geometry of purpose {', '.join(hidden)}" if hidden else ""
        raise RecordError("empty", f"no geometry of purpose {', '.join(purposes)}{found}")
    numbers = [*bound.GetMin(), *bound.GetMax()]
    if not all(math.isfinite(n) for n in numbers):
        raise RecordError("empty", f"its bound is not finite: {numbers}")
    if bound.GetSize().GetLength() == 0:
        raise RecordError("empty", f"there is nothing to draw: its bound is a single point, {tuple(bound.GetMin())}")
    return bound


def support_points(points) -> list[tuple[float, float, float]]:
    """The furthest of points (N, 3) in a thousand directions: their convex hull, to a thousandth of its size."""
    return [tuple(map(float, points[i])) for i in support_indices(points)]


def support_indices(points):
    """Which of points (N, 3) are the furthest in a thousand directions."""
    import numpy as np

    count = 1000
    k = np.arange(count) + 0.5
    height, turn = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k  # a Fibonacci sphere
    flat = np.sqrt(1 - height**2)
    directions = np.column_stack([flat * np.cos(turn), flat * np.sin(turn), height])
    centered = points - points.mean(axis=0)
    blocks = [np.argmax(centered @ directions[start : start + 50].T, axis=0) for start in range(0, count, 50)]
    return np.unique(np.concatenate(blocks))


def mesh_corners(prim, cache, time) -> list:
    """World points whose hull holds a mesh, or its bound's corners where its extent holds more than its points.

    A shader that displaces needs an extent wider than the points (or Storm culls it), so such a mesh is its extent.
    """
    from pxr import Gf, UsdGeom

    local = cache.ComputeUntransformedBound(prim).ComputeAlignedRange()
    matrix = UsdGeom.Imageable(prim).ComputeLocalToWorldTransform(time)
    found = [tuple(local.GetCorner(i)) for i in range(8)]
    if importlib.util.find_spec("numpy") is not None:  # a studio's interpreter may lack it
        import numpy as np

        points = np.array(UsdGeom.Mesh(prim).GetPointsAttr().Get(time) or (), dtype=np.float64).reshape(-1, 3)
        slack = 1e-3 * local.GetSize().GetLength()
        low, high = np.array(local.GetMin()) + slack, np.array(local.GetMax()) - slack
        if len(points) and np.all(points.min(axis=0) <= low) and np.all(points.max(axis=0) >= high):
            found = support_points(points)
    return [matrix.Transform(Gf.Vec3d(*corner)) for corner in found]


def prototype_box(prototype, cache, time):
    """The box (2, 3) of what an instancer repeats, in its own space, and how large it is if a shader displaces it.

    The extent of a mesh is taken for a shader's where it holds more than the points: that is how far any edit may
    lead, not what is drawn, so such a mesh is the box of its points.
    """
    import numpy as np
    from pxr import UsdGeom

    bound = cache.ComputeUntransformedBound(prototype).ComputeAlignedRange()
    box = np.zeros((2, 3)) if bound.IsEmpty() else np.array([bound.GetMin(), bound.GetMax()])
    if not prototype.IsA(UsdGeom.Mesh):
        return box, 0.0
    points = np.array(UsdGeom.Mesh(prototype).GetPointsAttr().Get(time) or (), dtype=np.float64).reshape(-1, 3)
    if not len(points):
        return box, 0.0
    plain = np.array([points.min(axis=0), points.max(axis=0)])
    size = float(np.ptp(plain, axis=0).max())
    displaced = np.any(plain[0] - box[0] > 1e-3 * size) or np.any(box[1] - plain[1] > 1e-3 * size)
    return plain, size if displaced else 0.0


def instance_corners(boxes, matrices, extent):
    """Points (P, 3) whose hull holds boxes (N, 2, 3) placed by matrices (N, 4, 4) within extent (2, 3), if any.

    What a box has in common with the extent ends on edges of either: a few leaves need points along these; of many
    leaves, each is too small to matter.
    """
    import numpy as np

    places = edge_places(17 if len(boxes) <= 500 else 2)
    points = boxes[:, None, 0] + places * (boxes[:, None, 1] - boxes[:, None, 0])
    points = points @ matrices[:, :3, :3] + matrices[:, 3:, :3]
    if extent is None:
        return points.reshape(-1, 3)
    ends = extent[0] + places * (extent[1] - extent[0])
    turnable = np.abs(np.linalg.det(matrices[:, :3, :3])) > 0
    local = (ends - matrices[turnable, 3:, :3]) @ np.linalg.inv(matrices[turnable, :3, :3])
    inside = ((local >= boxes[turnable, :1]) & (local <= boxes[turnable, 1:])).all(axis=2).any(axis=0)
    return np.concatenate([np.clip(points.reshape(-1, 3), *extent), ends[inside]])


def edge_places(count: int):
    """Points (P, 3) on the edges of the box from 0 to 1, so many on each, every corner once."""
    import numpy as np

    along = np.stack(np.meshgrid(np.linspace(0, 1, count), [0, 1], [0, 1], indexing="ij"), axis=-1).reshape(-1, 3)
    return np.unique(np.concatenate([np.roll(along, axis, axis=1) for axis in range(3)]), axis=0)


def instancer_corners(prim, cache, time) -> list:
    """World points whose hull holds what an instancer draws: corners of its instances' boxes, or of its own.

    Of very many instances only those that lie furthest out are looked at, so that one a little further in may reach out
    by less than its size. How far a shader displaces them is guessed from the instancer's extent.
    """
    from pxr import Gf, UsdGeom

    matrix = UsdGeom.Imageable(prim).ComputeLocalToWorldTransform(time)
    bound = cache.ComputeUntransformedBound(prim).ComputeAlignedRange()
    found = [tuple(bound.GetCorner(i)) for i in range(8)]
    instancer = UsdGeom.PointInstancer(prim)
    transforms = instancer.ComputeInstanceTransformsAtTime(time, time)
    if transforms and importlib.util.find_spec("numpy") is not None:  # a studio's interpreter may lack it
        import numpy as np

        targets = instancer.GetPrototypesRel().GetForwardedTargets()
        prototypes = [prototype_box(prim.GetStage().GetPrimAtPath(path), cache, time) for path in targets]
        drawn = np.array(instancer.ComputeMaskAtTime(time) or [True] * len(transforms))
        used = np.array(instancer.GetProtoIndicesAttr().Get(time))[drawn]
        matrices = np.array(transforms)
        if len(matrices) > 20000:
            outer = support_indices(matrices[:, 3, :3])
            matrices, used = matrices[outer], used[outer]
        boxes, sizes = np.array([box for box, _ in prototypes])[used], np.array([size for _, size in prototypes])[used]
        extent = np.array([bound.GetMin(), bound.GetMax()])
        plain = instance_corners(boxes, matrices, None)
        excess = max(0.0, (plain.min(axis=0) - extent[0]).max(), (extent[1] - plain.max(axis=0)).max())
        scales = np.linalg.norm(matrices[:, :3, :3], axis=2).max(axis=1)
        reach = np.where(sizes > 0, GROWTH * sizes + EXCESSES * excess / np.maximum(scales, 1e-30), 0.0)[:, None]
        corners = instance_corners(np.stack([boxes[:, 0] - reach, boxes[:, 1] + reach], axis=1), matrices, extent)
        found = support_points(corners)
    return [matrix.Transform(Gf.Vec3d(*corner)) for corner in found]


def measure_shape(stage, time, purposes: list[str]):
    """What cameras have to show: tighter than the stage's bound where meshes are drawn as they are."""
    from framing import Shape
    from pxr import Usd, UsdGeom
    from weight import is_drawn_as_cards

    bound = compute_bound(stage, time, purposes)
    cache = UsdGeom.BBoxCache(time, purposes, useExtentsHint=False)
    drawn = []
    prims = iter(Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()))
    for prim in prims:
        has_cards = is_drawn_as_cards(prim, time)
        if not (has_cards or prim.IsA(UsdGeom.Boundable)):
            continue
        prims.PruneChildren()  # what is below an instancer are its prototypes
        if UsdGeom.Imageable(prim).ComputeVisibility(time) != UsdGeom.Tokens.invisible:
            drawn.append((prim, has_cards))
    corners = []
    for prim, has_cards in drawn:
        world = cache.ComputeWorldBound(prim).ComputeAlignedRange()
        if world.IsEmpty():  # of another purpose, or without geometry
            continue
        if has_cards or len(drawn) > MANY_PRIMS:  # a little of each box may be empty, which then shows no more
            corners.extend(world.GetCorner(i) for i in range(8))
        elif prim.IsA(UsdGeom.Mesh):
            corners.extend(mesh_corners(prim, cache, time))
        elif prim.IsA(UsdGeom.PointInstancer):
            corners.extend(instancer_corners(prim, cache, time))
        else:
            corners.extend(world.GetCorner(i) for i in range(8))
    return Shape(middle=bound.GetMidpoint(), corners=tuple(corners), reach=bound.GetSize().GetLength())


def stage_camera(stage, path: str, time):
    """The camera prim at a path, as a Gf.Camera."""
    from pxr import Sdf, UsdGeom

    cameras = [str(prim.GetPath()) for prim in stage.Traverse() if prim.IsA(UsdGeom.Camera)]
    if not Sdf.Path.IsValidPathString(path) or not Sdf.Path(path).IsAbsolutePath() or path not in cameras:
        there = f"its cameras are {', '.join(cameras)}" if cameras else "it has none"
        raise RecordError("camera", f"no camera at {path}; {there}")
    return UsdGeom.Camera(stage.GetPrimAtPath(path)).GetCamera(time)


def unresolved_assets(stage) -> list[str]:
    """One line for each asset path of the composed stage that leads nowhere; Storm does not report them."""
    from pxr import Sdf

    kinds = (Sdf.ValueTypeNames.Asset, Sdf.ValueTypeNames.AssetArray)
    missing = []
    for prim in stage.Traverse():
        for attribute in prim.GetAuthoredAttributes():
            if attribute.GetTypeName() not in kinds:
                continue
            value = attribute.Get()
            assets = [value] if isinstance(value, Sdf.AssetPath) else list(value or ())
            for asset in assets:
                if asset.path and not asset.resolvedPath and "<UDIM>" not in asset.path:
                    missing.append(f"{attribute.GetPath()}: no file {asset.path}")
    return missing


def view_cameras(stage, time, views: list[dict], purposes: list[str]) -> list:
    """The camera of every view, in order."""
    from framing import (
        Direction,
        distance_to_fit,
        fit_window,
        frame_orthographic,
        frame_perspective,
        place_pinhole,
    )
    from pxr import CameraUtil, UsdGeom

    z_up = UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z
    shape = None
    if any("camera" not in view and "pinhole" not in view for view in views):
        shape = measure_shape(stage, time, purposes)
    bound = compute_bound(stage, time, purposes) if any("pinhole" in view for view in views) else None

    def direction_of(view: dict) -> Direction:
        return Direction(azimuth_rad=view["azimuth_rad"], elevation_rad=view["elevation_rad"])

    shared: dict[str, float] = {}  # views of one group keep one distance, so that a turntable does not pump
    for view in views:
        if "group" in view:
            needed = distance_to_fit(shape, direction_of(view), z_up, view["width_px"], view["height_px"])
            shared[view["group"]] = max(needed, shared.get(view["group"], 0.0))

    cameras = []
    for view in views:
        width_px, height_px = view["width_px"], view["height_px"]
        if "camera" in view:
            camera = stage_camera(stage, view["camera"], time)
            CameraUtil.ConformWindow(camera, CameraUtil.Fit, width_px / height_px)
        elif "pinhole" in view:
            camera = place_pinhole(view["pinhole"], width_px, height_px, bound)
        elif view["orthographic"]:
            window = view.get("window") or fit_window(shape, direction_of(view), z_up, width_px, height_px)
            camera = frame_orthographic(shape, direction_of(view), z_up, tuple(window))
        else:
            distance = shared.get(view.get("group", ""))
            camera = frame_perspective(shape, direction_of(view), z_up, width_px, height_px, distance)
        cameras.append(camera)
    return cameras


class Selected(NamedTuple):
    """What of the stage some views show, and in which light."""

    variants: tuple[tuple[str, str], ...]
    purposes: tuple[str, ...]
    even_light: bool


def selected_by(view: dict, request: dict) -> Selected:
    """What a view shows: its own choice, or that of the request."""
    return Selected(
        variants=tuple(view.get("variants", request.get("variants", {})).items()),
        purposes=tuple(view.get("purposes", request["purposes"])),
        even_light=view.get("light", request.get("light", "")) == "even",
    )


def show(stage, selected: Selected, time):
    """Select variants on the stage, and no others in its session layer; how much there is to draw then, and as what."""
    from weight import lighten

    stage.GetSessionLayer().Clear()
    for name, chosen in selected.variants:
        select_variant(stage, name, chosen)
    return lighten(stage, time, list(selected.purposes), [name for name, _ in selected.variants])


def choose_common_scale(stage, time, request: dict, groups: dict[Selected, list[int]]) -> int:
    """By how much all pictures are drawn larger: as the group that has most to draw wants it."""
    from weight import choose_complexity, choose_scale

    sizes_px = [(view["width_px"], view["height_px"]) for view in request["views"]]
    scale = 1
    for selected in groups:
        weight, _ = show(stage, selected, time)
        complexity = choose_complexity(weight, request["complexity"])
        scale = max(scale, choose_scale(weight, complexity, request.get("samples", SAMPLES), sizes_px))
    return scale


def record_views(request: dict) -> dict:
    """Draw every view to its EXR (linear, premultiplied alpha); returns the result but for the versions."""
    from lighting import PREVIEW_ROOT, author_lights, author_sky, has_lights
    from pxr import Sdf, Tf, Usd, UsdAppUtils, UsdGeom
    from weight import choose_complexity

    stage = open_stage(request["usd_file"], request.get("muted", []))
    time = Usd.TimeCode(stage.GetStartTimeCode()) if stage.HasAuthoredTimeCodeRange() else Usd.TimeCode.Default()
    if "frame" in request:
        time = Usd.TimeCode(request["frame"])
    z_up = UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z
    groups: dict[Selected, list[int]] = {}  # views that show the same, drawn one after another
    for number, view in enumerate(request["views"]):
        groups.setdefault(selected_by(view, request), []).append(number)
    scale = request.get("scale")
    if scale is None:
        scale = choose_common_scale(stage, time, request, groups)
        if scale > 1:
            raise LargerPictures(scale)

    recorder = UsdAppUtils.FrameRecorder()
    if not recorder.SetRendererPlugin("HdStormRendererPlugin"):
        raise RecordError("usd", "this USD has no Storm (HdStormRendererPlugin)")
    recorder.SetColorCorrectionMode("disabled")  # the product composites in linear light, then encodes sRGB
    recorder.SetCameraLightEnabled(False)
    recorder.SetDomeLightVisibility(False)

    drawn: dict[int, dict] = {}
    warnings: list[str] = []
    complexities, triangles, lighter_forms = [], [], []
    for selected, numbers in groups.items():
        weight, lighter = show(stage, selected, time)
        complexities.append(choose_complexity(weight, request["complexity"]))
        triangles.append(weight.drawn(0))
        lighter_forms.append(lighter)
        views = [request["views"][number] for number in numbers]
        cameras = view_cameras(stage, time, views, list(selected.purposes))
        lit = has_lights(stage)
        recorder.SetComplexity(complexities[-1])
        recorder.SetIncludedPurposes([purpose for purpose in selected.purposes if purpose != "default"])
        camera_prim = UsdGeom.Camera.Define(stage, Sdf.Path(PREVIEW_ROOT).AppendChild("Camera"))
        for number, view, camera in zip(numbers, views, cameras, strict=True):
            width_px, height_px = scale * view["width_px"], scale * view["height_px"]
            # The recorder rounds the height down; a fiftieth of a pixel keeps it from losing a row.
            camera.verticalAperture = camera.horizontalAperture * (height_px + 0.02) / width_px
            drawn_time = Usd.TimeCode(view["frame"]) if "frame" in view else time
            camera_prim.SetFromCamera(camera, drawn_time)
            if not lit and selected.even_light:
                author_sky(stage, z_up, request["dome_texture"])
            elif not lit:
                author_lights(stage, camera, z_up, request["dome_texture"])
            recorder.SetImageWidth(width_px)
            try:
                written = recorder.Record(stage, camera_prim, drawn_time, view["exr"])
            except Tf.ErrorException as error:
                raise RecordError("draw", f"Storm failed: {message_of(error)}") from error
            if not written or not Path(view["exr"]).exists():
                raise RecordError("draw", f"Storm wrote no picture {number}")
            drawn[number] = {
                "stage_from_camera": [list(row) for row in camera.transform],  # USD's row vectors
                "window": [*camera.frustum.window.min, *camera.frustum.window.max],
            }
            print(f"usdfoliage-frame {len(drawn)} {len(request['views'])}", flush=True)
        warnings += unresolved_assets(stage)
    return {
        "views": [drawn[number] for number in range(len(drawn))],
        "warnings": list(dict.fromkeys(warnings)),
        "complexity": min(complexities),
        "scale": scale,
        "triangles": max(triangles),
        "lighter": next((each for each in lighter_forms if each), ""),
    }


def main(request_path: str, result_path: str) -> int:
    request = json.loads(Path(request_path).read_text(encoding="utf-8"))
    if "samples" in request:
        os.environ["HDX_MSAA_SAMPLE_COUNT"] = str(request["samples"])  # USD reads it as it is loaded
    try:
        version = load_usd()
        from gl_context import ContextError, make_context

        try:
            display = make_context()
        except ContextError as error:
            raise RecordError("gl", str(error)) from error
        result = {"usd_version": version, "egl_display": display, **record_views(request)}
    except LargerPictures as larger:
        larger_request = json.dumps({**request, "samples": 1, "scale": larger.scale})
        Path(request_path).write_text(larger_request, encoding="utf-8")
        os.execv(sys.executable, [sys.executable, str(Path(__file__).resolve()), request_path, result_path])
    except RecordError as error:
        result = {"error": {"kind": error.kind, "message": str(error)}}
    Path(result_path).write_text(json.dumps(result), encoding="utf-8")
    sys.stdout.flush()
    sys.stderr.flush()
    # Storm's and Blender's clean-up after the context is gone may crash a process that has done its work.
    os._exit(1 if "error" in result else 0)


if __name__ == "__main__":
    main(*sys.argv[1:3])
