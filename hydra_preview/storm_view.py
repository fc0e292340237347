"""A widget in which Storm draws a stage."""

import sys
import time
from dataclasses import replace

from framing import Direction
from lighting import author_key, author_sky, has_lights
from orbit import Orbit, camera_of, frame_all, truck, tumble, zoom, zoom_wheel
from pxr import CameraUtil, Gf, Tf, Usd, UsdGeom, UsdImagingGL
from PySide6 import QtCore, QtGui
from PySide6.QtOpenGLWidgets import QOpenGLWidget
from record import RecordError, measure_shape, message_of

STORM = "HdStormRendererPlugin"
BACKGROUND = (0.36, 0.37, 0.38)  # sRGB as displayed, as usdfoliage preview has it
START = Direction(azimuth_rad=0.61, elevation_rad=0.21)
COARSE = 1.0  # complexity while something moves
COLOR_AND_DEPTH = 0x4000 | 0x0100  # GL_COLOR_BUFFER_BIT, GL_DEPTH_BUFFER_BIT
GL_BLEND = 0x0BE2
CONVERGE_MS = 5


def surface_format() -> QtGui.QSurfaceFormat:
    """What Storm wants of OpenGL; to be the default before the application is made."""
    wanted = QtGui.QSurfaceFormat()
    wanted.setVersion(4, 5)
    wanted.setProfile(QtGui.QSurfaceFormat.CompatibilityProfile)
    wanted.setOption(QtGui.QSurfaceFormat.DeprecatedFunctions)
    wanted.setDepthBufferSize(24)
    wanted.setSamples(0)  # Storm has samples of its own
    return wanted


class StormView(QOpenGLWidget):
    """The stage, from a camera that the mouse leads."""

    failed = QtCore.Signal(str)  # once, with what is wrong

    def __init__(self, stage: Usd.Stage, dome_texture: str, complexity: float = 1.1, parent=None) -> None:
        super().__init__(parent)
        self.stage = stage
        self.purposes = {"render": True, "proxy": False, "guide": False}
        self.complexity = complexity
        self.seconds = 0.0  # the last picture took
        self._coarse = False  # while a slider of the panel is pressed
        self._buttons = None  # what a drag does, as a function of orbit and pixels
        self._at = QtCore.QPointF()
        self._engine = None
        self._has_failed = False
        self._z_up = UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z
        self._time = (
            Usd.TimeCode(stage.GetStartTimeCode()) if stage.HasAuthoredTimeCodeRange() else Usd.TimeCode.Default()
        )
        self._own_lights = not has_lights(stage)
        with Usd.EditContext(stage, stage.GetSessionLayer()):
            if self._own_lights:
                author_sky(stage, self._z_up, dome_texture)
        self._shape = measure_shape(stage, self._time, self._drawn_purposes())
        self._orbit = Orbit(target=self._shape.middle, direction=START, distance=self._shape.reach, z_up=self._z_up)
        self._framed = False
        self.setFocusPolicy(QtCore.Qt.StrongFocus)
        self.setMinimumSize(160, 120)

    # What is shown

    def show_purpose(self, name: str, visible: bool) -> None:
        self.purposes[name] = visible
        self._measure()
        self.update()

    def frame_all(self) -> None:
        """Stand where all is seen, in the direction that there is."""
        self._measure()
        self._orbit = frame_all(self._shape, self._orbit.direction, self._z_up, self.width(), self.height())
        self.update()

    def show_time(self, time_code: float) -> None:
        """Draw what moves as it is at a time code."""
        self._time = Usd.TimeCode(time_code)
        self.update()

    def turn(self, azimuth_rad: float) -> None:
        """Go around the target; a drag of the mouse comes first."""
        if self._buttons is None:
            direction = self._orbit.direction
            turned = Direction(azimuth_rad=direction.azimuth_rad + azimuth_rad, elevation_rad=direction.elevation_rad)
            self._orbit = replace(self._orbit, direction=turned)
            self.update()

    def draw_coarsely(self, coarse: bool) -> None:
        """Draw coarsely while something is moved."""
        self._coarse = coarse
        self.update()

    def _drawn_purposes(self) -> list[str]:
        return ["default", *(name for name, visible in self.purposes.items() if visible)]

    def _measure(self) -> None:
        try:
            self._shape = measure_shape(self.stage, self._time, self._drawn_purposes())
        except RecordError:  # nothing is shown, as where all purposes are switched off: the last shape will do
            return

    # The mouse

    def mousePressEvent(self, event) -> None:
        self._at = event.position()
        narrow_px = min(self.width(), self.height())
        self._buttons = {
            QtCore.Qt.LeftButton: tumble,
            QtCore.Qt.MiddleButton: lambda orbit, x, y: truck(orbit, x, y, narrow_px),
            QtCore.Qt.RightButton: zoom,
        }.get(event.button())

    def mouseMoveEvent(self, event) -> None:
        if self._buttons is None:
            return
        moved = event.position() - self._at
        self._at = event.position()
        self._orbit = self._buttons(self._orbit, moved.x(), moved.y())
        self.update()

    def mouseReleaseEvent(self, _event) -> None:
        self._buttons = None
        self.update()

    def wheelEvent(self, event) -> None:
        self._orbit = zoom_wheel(self._orbit, event.angleDelta().y())
        self.update()

    # OpenGL

    def initializeGL(self) -> None:
        major, minor = self.context().format().version()
        if (major, minor) < (4, 5):
            self._fail(f"OpenGL {major}.{minor} is offered, 4.5 is needed")
            return
        try:
            self._engine = UsdImagingGL.Engine()
            if not self._engine.SetRendererPlugin(STORM):
                self._fail(f"this USD has no Storm ({STORM})")
            self._engine.SetRendererAov("color")  # with samples and colour correction; without one Storm draws plainly
            self._engine.SetRendererSetting("domeLightCameraVisibility", False)
        except (Tf.ErrorException, TypeError) as error:  # else Qt goes on without a picture
            self._fail(message_of(error))

    def paintGL(self) -> None:
        functions = self.context().functions()
        functions.glClearColor(*BACKGROUND, 1.0)
        functions.glClear(COLOR_AND_DEPTH)
        functions.glDisable(GL_BLEND)
        if self._engine is None or self._has_failed:
            return
        if not self._framed:  # now its size is known
            self._framed = True
            self.frame_all()
        started = time.monotonic()
        try:
            self._draw()
        except (Tf.ErrorException, TypeError) as error:
            self._fail(f"Storm failed: {message_of(error)}")
            return
        self.seconds = time.monotonic() - started
        if not self._engine.IsConverged():
            QtCore.QTimer.singleShot(CONVERGE_MS, self.update)

    def _draw(self) -> None:
        width_px, height_px = (round(side * self.devicePixelRatioF()) for side in (self.width(), self.height()))
        camera = camera_of(self._orbit, self._shape, width_px, height_px)
        if self._own_lights:
            with Usd.EditContext(self.stage, self.stage.GetSessionLayer()):
                author_key(self.stage, camera)
        engine = self._engine
        engine.SetRenderBufferSize(Gf.Vec2i(width_px, height_px))
        engine.SetFraming(CameraUtil.Framing(Gf.Rect2i(Gf.Vec2i(0, 0), width_px, height_px)))
        frustum = camera.frustum
        engine.SetCameraState(frustum.ComputeViewMatrix(), frustum.ComputeProjectionMatrix())
        params = UsdImagingGL.RenderParams()
        params.frame = self._time
        params.complexity = COARSE if self._coarse or self._buttons is not None else self.complexity
        params.showRender, params.showProxy = self.purposes["render"], self.purposes["proxy"]
        params.showGuides = self.purposes["guide"]
        params.enableLighting = True
        params.colorCorrectionMode = "sRGB"
        params.clearColor = Gf.ConvertDisplayToLinear(Gf.Vec4f(*BACKGROUND, 1.0))
        engine.Render(self.stage.GetPseudoRoot(), params)

    def _fail(self, text: str) -> None:
        if not self._has_failed:
            self._has_failed = True
            print(text, file=sys.stderr)
            self.failed.emit(text)
