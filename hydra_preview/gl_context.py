"""An OpenGL context for Storm on a machine without a display, through EGL.

Storm wants OpenGL 4.5 in the *compatibility* profile with a pbuffer as draw surface: with a core profile, or without a
draw surface, it ends in GL errors.
"""

import ctypes
from collections.abc import Iterator

PLATFORM_SURFACELESS_MESA = 0x31DD
PLATFORM_DEVICE_EXT = 0x313F
OPENGL_API = 0x30A2
EXTENSIONS = 0x3055
NONE = 0x3038

CONFIG_ATTRIBUTES = (
    *(0x3033, 0x0001),  # SURFACE_TYPE: PBUFFER_BIT
    *(0x3040, 0x0008),  # RENDERABLE_TYPE: OPENGL_BIT
    *(0x3024, 8, 0x3023, 8, 0x3022, 8, 0x3021, 8),  # RED, GREEN, BLUE, ALPHA_SIZE
    *(0x3025, 24),  # DEPTH_SIZE
    NONE,
)
SURFACE_ATTRIBUTES = (0x3057, 64, 0x3056, 64, NONE)  # WIDTH, HEIGHT; Storm draws into its own buffers
CONTEXT_ATTRIBUTES = (0x3098, 4, 0x30FB, 5, 0x30FD, 0x0002, NONE)  # MAJOR, MINOR, PROFILE_MASK: COMPATIBILITY


class ContextError(Exception):
    """No context that Storm can draw in; the message names what EGL lacked."""


def _integers(values: tuple[int, ...]) -> ctypes.Array:
    return (ctypes.c_int * len(values))(*values)


def _load_egl() -> ctypes.CDLL:
    try:
        egl = ctypes.CDLL("libEGL.so.1")
    except OSError as error:
        raise ContextError(f"EGL cannot be loaded: {error}") from error
    pointer = ctypes.c_void_p
    for name, result, arguments in (
        ("eglGetProcAddress", pointer, [ctypes.c_char_p]),
        ("eglQueryString", ctypes.c_char_p, [pointer, ctypes.c_int]),
        ("eglInitialize", ctypes.c_uint, [pointer, pointer, pointer]),
        ("eglBindAPI", ctypes.c_uint, [ctypes.c_uint]),
        ("eglChooseConfig", ctypes.c_uint, [pointer, pointer, pointer, ctypes.c_int, pointer]),
        ("eglCreatePbufferSurface", pointer, [pointer, pointer, pointer]),
        ("eglCreateContext", pointer, [pointer, pointer, pointer, pointer]),
        ("eglMakeCurrent", ctypes.c_uint, [pointer, pointer, pointer, pointer]),
        ("eglGetError", ctypes.c_int, []),
    ):
        function = getattr(egl, name)
        function.restype, function.argtypes = result, arguments
    return egl


def _displays(egl: ctypes.CDLL) -> Iterator[tuple[str, int]]:
    """Every display that needs no window system: Mesa's surfaceless one, then one for each device (NVIDIA)."""
    extensions = (egl.eglQueryString(None, EXTENSIONS) or b"").decode()
    address = egl.eglGetProcAddress(b"eglGetPlatformDisplayEXT")
    if not address:
        return
    get_display = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_uint, ctypes.c_void_p, ctypes.c_void_p)(address)
    if "EGL_MESA_platform_surfaceless" in extensions:
        display = get_display(PLATFORM_SURFACELESS_MESA, None, None)
        if display:
            yield "surfaceless", display
    query = egl.eglGetProcAddress(b"eglQueryDevicesEXT")
    if query and "EGL_EXT_platform_device" in extensions:
        query_devices = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)(query)
        devices, count = (ctypes.c_void_p * 16)(), ctypes.c_int()
        if query_devices(16, devices, ctypes.byref(count)):
            for number in range(count.value):
                display = get_display(PLATFORM_DEVICE_EXT, devices[number], None)
                if display:
                    yield f"device {number}", display


def _make_current(egl: ctypes.CDLL, display: int) -> str | None:
    """Make a context on the display current; None, or what failed."""
    if not egl.eglInitialize(display, None, None):
        return "eglInitialize failed"
    if not egl.eglBindAPI(OPENGL_API):
        return "it has no desktop OpenGL"
    config, count = ctypes.c_void_p(), ctypes.c_int()
    attributes = _integers(CONFIG_ATTRIBUTES)
    if not egl.eglChooseConfig(display, attributes, ctypes.byref(config), 1, ctypes.byref(count)) or not count.value:
        return "it has no 8-bit RGBA pbuffer with depth"
    surface = egl.eglCreatePbufferSurface(display, config, _integers(SURFACE_ATTRIBUTES))
    if not surface:
        return f"no pbuffer (EGL error {egl.eglGetError():#x})"
    context = egl.eglCreateContext(display, config, None, _integers(CONTEXT_ATTRIBUTES))
    if not context:
        return f"no OpenGL 4.5 compatibility context (EGL error {egl.eglGetError():#x})"
    if not egl.eglMakeCurrent(display, surface, surface, context):
        return f"the context cannot be made current (EGL error {egl.eglGetError():#x})"
    return None


def make_context() -> str:
    """Make an OpenGL 4.5 context current in this thread for as long as the process lives; returns the display's name.

    Raises:
        ContextError: No EGL, no display without a window system, or none with such a context.
    """
    egl = _load_egl()
    failures = []
    for name, display in _displays(egl):
        failure = _make_current(egl, display)
        if failure is None:
            return name
        failures.append(f"{name}: {failure}")
    raise ContextError("EGL offers no display for OpenGL: " + ("; ".join(failures) or "no driver found"))
