"""Pictures as usdview draws them: Storm's engine with a light at the eye, and with what is selected shown.

Run by the preview's interpreter: pictures.py REQUEST.json, with asset, picture (an .npy file), width_px,
selected: None, the path of a prim, or that and the number of an instance, and guides: those that the panel shows.
"""

import ctypes
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[3]
GREY = 0.3  # of the background, linear


def draw_as_usdview(
    python: Path,
    asset: Path,
    picture: Path,
    width_px: int = 240,
    selected: tuple[str, int | None] | None = None,
    guides: tuple[str, ...] = (),
) -> np.ndarray:
    """(H, W, 3) uint8, sRGB, the asset from a corner; python is the preview's interpreter."""
    from usdfoliage.jobs.preview.recorder import recorder_environment  # that interpreter has no usdfoliage

    request = {
        "asset": str(asset),
        "picture": str(picture),
        "width_px": width_px,
        "selected": selected,
        "guides": guides,
    }
    modules = os.pathsep.join(str(ROOT / name) for name in ("hydra_preview", "usd_plugins"))
    environment = {**recorder_environment(picture.parent), "PYTHONPATH": modules}
    run = [str(python), __file__, json.dumps(request)]
    outcome = subprocess.run(run, env=environment, capture_output=True, text=True, check=False)
    assert outcome.returncode == 0, outcome.stderr
    return np.load(picture)


def _bind_buffer(width_px: int) -> ctypes.CDLL:
    """Bind an OpenGL buffer of that size, for Storm to present its picture to."""
    gl = ctypes.CDLL("libGL.so.1")
    buffer = ctypes.c_uint()
    gl.glGenFramebuffers(1, ctypes.byref(buffer))
    gl.glBindFramebuffer(0x8D40, buffer)  # GL_FRAMEBUFFER
    for kind, attachment in ((0x8058, 0x8CE0), (0x81A6, 0x8D00)):  # RGBA8 as colour 0, DEPTH_COMPONENT24 as depth
        part = ctypes.c_uint()
        gl.glGenRenderbuffers(1, ctypes.byref(part))
        gl.glBindRenderbuffer(0x8D41, part)
        gl.glRenderbufferStorage(0x8D41, kind, width_px, width_px)
        gl.glFramebufferRenderbuffer(0x8D40, attachment, 0x8D41, part)
    gl.glViewport(0, 0, width_px, width_px)
    gl.glClear(0x4100)
    return gl


def _draw(request: dict) -> None:
    from record import load_usd, measure_shape

    load_usd()
    from framing import Direction, frame_perspective
    from gl_context import make_context

    make_context()
    from pxr import CameraUtil, Gf, Glf, Sdf, Usd, UsdImagingGL

    side, time = request["width_px"], Usd.TimeCode.Default()
    stage = Usd.Stage.Open(request["asset"])
    if request["guides"]:
        from usdviewFoliage.plants import show_guides

        show_guides(stage, set(request["guides"]))
    shape = measure_shape(stage, time, ["default", "render"])
    frustum = frame_perspective(shape, Direction(azimuth_rad=0.6, elevation_rad=0.3), False, side, side, None).frustum
    gl = _bind_buffer(side)
    engine = UsdImagingGL.Engine()
    engine.SetRendererPlugin("HdStormRendererPlugin")
    engine.SetRendererAov("color")
    engine.SetRenderBufferSize(Gf.Vec2i(side, side))
    engine.SetFraming(CameraUtil.Framing(Gf.Rect2i(Gf.Vec2i(0, 0), side, side)))
    engine.SetCameraState(frustum.ComputeViewMatrix(), frustum.ComputeProjectionMatrix())
    light = Glf.SimpleLight()
    light.ambient = Gf.Vec4f(0, 0, 0, 0)
    light.position = Gf.Vec4f(*frustum.position, 1)  # usdview's camera light
    engine.SetLightingState([light], Glf.SimpleMaterial(), Gf.Vec4f(0.01, 0.01, 0.01, 1))
    parameters = UsdImagingGL.RenderParams()
    parameters.complexity = 1.1
    parameters.enableLighting = parameters.highlight = True
    parameters.colorCorrectionMode = "sRGB"
    parameters.showGuides = bool(request["guides"])
    parameters.clearColor = Gf.Vec4f(GREY, GREY, GREY, 1)
    engine.Render(stage.GetPseudoRoot(), parameters)
    if request["selected"] is not None:  # of what was drawn before: the engine knows no other
        path, instance = request["selected"]
        engine.SetSelectionColor(Gf.Vec4f(1, 1, 0, 0.5))
        if instance is None:
            engine.SetSelected([Sdf.Path(path)])
        else:
            engine.AddSelected(Sdf.Path(path), instance)
        engine.Render(stage.GetPseudoRoot(), parameters)
    pixels = (ctypes.c_ubyte * (side * side * 4))()
    gl.glReadPixels(0, 0, side, side, 0x1908, 0x1401, pixels)  # RGBA, UNSIGNED_BYTE
    np.save(request["picture"], np.frombuffer(pixels, np.uint8).reshape(side, side, 4)[::-1, :, :3])
    sys.stdout.flush()
    os._exit(0)  # Storm's clean-up after its context is gone may crash


if __name__ == "__main__":
    _draw(json.loads(sys.argv[1]))
