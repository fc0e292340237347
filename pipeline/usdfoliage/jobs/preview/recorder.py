"""The preview interpreter: found, started on a request, followed, and its failures put into words.

hydra_preview/README.md describes request and result.
"""

import contextlib
import json
import logging
import math
import os
import re
import selectors
import signal
import subprocess
import time
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from usdfoliage.asset.resources import resource_folder
from usdfoliage.errors import PreviewError, PreviewTimeoutError
from usdfoliage.files.children import bound_command
from usdfoliage.progress import Progress

logger = logging.getLogger(__name__)

_TO_END_S = 60.0  # after it has closed its output

REPOSITORY = Path(__file__).resolve().parents[4]
INTERPRETER_VARIABLE = "USDFOLIAGE_HYDRA_PYTHON"

DEBIAN_GL = "apt-get install libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri"
DEBIAN_LIBRARIES: Mapping[str, str] = MappingProxyType(
    {
        "libEGL": "libegl1",
        "libGL": "libgl1",
        "libX11": "libx11-6",
        "libXext": "libxext6",
        "libXi": "libxi6",
        "libXfixes": "libxfixes3",
        "libXrender": "libxrender1",
        "libxkbcommon": "libxkbcommon0",
        "libSM": "libsm6",
        "libICE": "libice6",
    }
)


def find_interpreter() -> Path:
    """The Python whose USD has imaging: USDFOLIAGE_HYDRA_PYTHON, else the repository's .venv-preview.

    Raises:
        PreviewError: It is not there.
    """
    chosen = os.environ.get(INTERPRETER_VARIABLE)
    if chosen:
        python = Path(chosen)
        if not os.access(python, os.X_OK) or python.is_dir():
            raise PreviewError(f"{INTERPRETER_VARIABLE} names no program that can be started ({python})", "correct it")
        return python
    python = REPOSITORY / ".venv-preview" / "bin" / "python"
    if not os.access(python, os.X_OK):
        how = "run `make setup`" if (REPOSITORY / "Makefile").is_file() else "pip install bpy==5.0.1 into a Python 3.11"
        raise PreviewError(
            f"the preview interpreter is missing ({python})",
            f"{how}, or set {INTERPRETER_VARIABLE} to a Python whose USD has imaging",
        )
    return python


def run_recorder(
    request: dict[str, Any],
    work: Path,
    stall_timeout_s: float,
    progress: Progress | None,
    time_limit_s: float = math.inf,
) -> dict[str, Any]:
    """Start the preview interpreter on a request; returns its result, with its complaints logged.

    Args:
        request: As hydra_preview/README.md describes it.
        work: A folder for its files.
        stall_timeout_s: Without a picture for so long it is ended.
        progress: Called with each picture.
        time_limit_s: For all pictures.

    Raises:
        PreviewTimeoutError: It drew for too long.
        PreviewError: It is missing, crashes, refuses, or could not compile a shader.
    """
    python = find_interpreter()
    recorder = resource_folder("hydra_preview") / "record.py"
    request_file, result_file, complaints_file = work / "request.json", work / "result.json", work / "stderr.txt"
    request_file.write_text(json.dumps(request), encoding="utf-8")
    with complaints_file.open("wb") as complaints:
        try:
            process = subprocess.Popen(
                bound_command([str(python), str(recorder), str(request_file), str(result_file)]),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=complaints,
                cwd=work,
                env=recorder_environment(work),
            )
        except OSError as error:
            raise PreviewError(f"the preview interpreter cannot be started: {error.strerror} ({python})") from error
        try:
            _follow_progress(process, stall_timeout_s, progress, time_limit_s)
        finally:
            process.kill()  # does nothing to one that has ended
            process.wait()
            if process.stdout is not None:
                process.stdout.close()
    text = complaints_file.read_text(encoding="utf-8", errors="replace")
    result = read_result(result_file)
    if result is None:
        raise PreviewError(describe_crash(process.returncode, text, python, request["usd_file"]))
    faults, warnings = sort_complaints(text)
    if "error" in result:
        kind, message = result["error"]["kind"], result["error"]["message"]
        if kind == "draw":
            message = "; ".join([message, *faults])  # where a shader did not compile, they hold its compiler's words
        raise PreviewError(describe_refusal(kind, message, request["usd_file"]))
    for warning in [*result["warnings"], *warnings]:
        logger.warning("%s (%s)", warning, request["usd_file"])
    if faults:
        raise PreviewError(f"Storm could not draw all of it: {'; '.join(faults)} ({request['usd_file']})")
    return result


def read_result(result_file: Path) -> dict[str, Any] | None:
    """What the preview interpreter wrote at its end; None where it did not come so far."""
    try:
        result: dict[str, Any] = json.loads(result_file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return result


def recorder_environment(work: Path) -> dict[str, str]:
    """What the preview interpreter is started with; work is for its temporary files."""
    environment = dict(os.environ)
    environment["TMPDIR"] = str(work)  # Blender leaves a folder there with every start
    if not environment.get(INTERPRETER_VARIABLE):
        # .venv-preview is complete; another pxr on PYTHONPATH would shadow its own.
        for name in ("PYTHONPATH", "PYTHONHOME"):
            environment.pop(name, None)
        environment["PYTHONNOUSERSITE"] = "1"
    environment["PYTHONDONTWRITEBYTECODE"] = "1"
    return environment


def _follow_progress(
    process: subprocess.Popen[bytes],
    stall_timeout_s: float,
    progress: Progress | None,
    time_limit_s: float = math.inf,
) -> None:
    """Read stdout to its end, reporting each frame; raises PreviewTimeoutError after too long a time."""
    assert process.stdout is not None
    pending = b""
    end = time.monotonic() + time_limit_s
    deadline = min(end, time.monotonic() + stall_timeout_s)
    with selectors.DefaultSelector() as selector:
        selector.register(process.stdout, selectors.EVENT_READ)
        while True:
            if not selector.select(max(0.0, deadline - time.monotonic())):
                text = f"Storm drew no picture within {stall_timeout_s:g} s"
                if deadline == end:
                    text = f"Storm did not draw all pictures within {time_limit_s:.3g} s"
                raise PreviewTimeoutError(text, "try a smaller size or a lower complexity")
            data = os.read(process.stdout.fileno(), 65536)
            if not data:
                break
            *lines, pending = (pending + data).split(b"\n")
            for line in lines:
                frame = re.fullmatch(rb".*usdfoliage-frame (\d+) (\d+)", line)
                if frame is not None:
                    deadline = min(end, time.monotonic() + stall_timeout_s)
                    if progress is not None:
                        progress(int(frame[1]), int(frame[2]))
    with contextlib.suppress(subprocess.TimeoutExpired):  # who called ends it; what it has written counts
        process.wait(timeout=_TO_END_S)


# Lines that mean an undrawn prim, and lines that mean nothing to anybody.
_FAULT = re.compile(r"failed to compile|failed to link|compile shader|GLSL.*error|program link", re.IGNORECASE)
_HARMLESS = re.compile(
    r"mip level \d+ does not exist"  # every texture that is not a mip map
    r"|^\d+:\d+\(\d+\): "  # a GLSL compiler's second error and those after it
    r"|XDG_RUNTIME_DIR"
)
_DIAGNOSTIC = re.compile(r"^(?:Warning|Error|Runtime Error|Coding Error|Fatal Error|Status)\b.*? -- (.*)$")


def sort_complaints(text: str) -> tuple[list[str], list[str]]:
    """The stderr of Storm as (faults, which leave prims undrawn; warnings), each once and without its place in C++."""
    faults: list[str] = []
    warnings: list[str] = []
    for raw in text.splitlines():
        line = raw.strip()
        if not line or _HARMLESS.search(line):
            continue
        diagnostic = _DIAGNOSTIC.match(line)
        message = diagnostic[1] if diagnostic else line
        if _FAULT.search(message):
            kind = faults
        elif diagnostic or re.search(r"error|fail|warn|invalid|cannot|could not", message, re.IGNORECASE):
            kind = warnings
        else:
            continue
        if message not in kind:
            kind.append(message)
    return faults, warnings


def describe_refusal(kind: str, message: str, usd_file: str) -> str:
    """The recorder's error with what to do about it."""
    if kind == "gl":
        return f"{message}; install OpenGL (Debian: {DEBIAN_GL})"
    if kind == "library":
        library = re.match(r"(lib\w+)[.\w-]*: cannot open shared object", message)
        package = DEBIAN_LIBRARIES.get(library[1]) if library else None
        return f"the preview interpreter lacks a library: {message}; " + (
            f"install it (Debian: apt-get install {package})" if package else "run `make setup`"
        )
    if kind == "usd":
        return (
            f"the preview interpreter has no USD with imaging: {message}; run `make setup`, "
            f"or set {INTERPRETER_VARIABLE} to a Python that has"
        )
    return f"{message} ({usd_file})"


def describe_crash(code: int, complaints: str, python: Path, usd_file: str = "") -> str:
    """An interpreter that ended without a result, with what it drew and its last output."""
    if code < 0:
        ended = f"was ended by {signal.Signals(-code).name}"
    else:
        ended = f"ended with code {code}"
    lines = [line.strip() for line in complaints.splitlines() if line.strip()]
    last = f"; its last words: {lines[-1]}" if lines else ""
    return (
        f"{usd_file}{': ' if usd_file else ''}the preview interpreter {ended} without a result{last} ({python}); "
        f"try another in {INTERPRETER_VARIABLE}, or `make setup`"
    )
