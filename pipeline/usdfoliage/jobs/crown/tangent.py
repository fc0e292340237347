"""The user's input for the tangents at a crown's silhouette: a number, a formula in i and j, or a map."""

import ast
import math
import operator
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.folder.raster import read_raster
from usdfoliage.errors import CaptureError, FoliageError

FLATTEST, STEEPEST = 0.1, 10.0  # 2 makes a ball; beyond these a crown is a sheet or a needle
FORMULA_SIZE = 256  # samples of a formula over the crown's bounds, along each axis

_BINARY: dict[type[ast.operator], Callable[..., NDArray[np.float64]]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_FUNCTIONS: dict[str, tuple[int, Callable[..., NDArray[np.float64]]]] = {  # number of arguments, function
    "abs": (1, np.abs),
    "cos": (1, np.cos),
    "exp": (1, np.exp),
    "max": (2, np.maximum),
    "min": (2, np.minimum),
    "sin": (1, np.sin),
    "sqrt": (1, np.sqrt),
}


def read_tangent(text: str) -> float | NDArray[np.float64] | None:
    """The tangent k that text means.

    Args:
        text: "auto"; a number; an image file with k in its (first) channel, integers standing for 0 to 4 and floats for
            themselves; or a formula such as "1 + 2*j" in i (from the left) and j (from the top), both 0 to 1 over the
            bounds of the crown, with + − * / **, abs cos exp max min sin sqrt and pi.

    Returns:
        None for "auto", a number, or a map (h, w).

    Raises:
        FoliageError: It is none of these, or k is not from FLATTEST to STEEPEST everywhere.
    """
    if text == "auto":
        return None
    try:
        return _positive_number(float(text), text)
    except ValueError:
        pass
    if Path(text).suffix and Path(text).exists():
        return _read_map(Path(text))
    if Path(text).suffix.lower() in (".exr", ".png", ".jpg", ".jpeg", ".tif", ".tiff"):
        raise CaptureError(f"tangent: there is no such map ({text})")
    across = (np.arange(FORMULA_SIZE) + 0.5) / FORMULA_SIZE
    i, j = np.meshgrid(across, across)
    try:
        with np.errstate(all="ignore"):
            tangent = _evaluate(ast.parse(text, mode="eval").body, {"i": i, "j": j, "pi": np.float64(math.pi)})
    except (SyntaxError, ValueError, TypeError, RecursionError, MemoryError, OverflowError) as error:
        raise FoliageError(
            f"tangent {text!r} is no number, file or formula ({error})", "write for example 2, tangent.exr or '1 + 2*j'"
        ) from error
    return _check(np.broadcast_to(np.asarray(tangent, dtype=np.float64), i.shape), f"tangent {text!r}")


def _positive_number(value: float, text: str) -> float:
    if not FLATTEST <= value <= STEEPEST:  # NaN is not either
        raise FoliageError(f"tangent must be a positive number from {FLATTEST:g} to {STEEPEST:g}, not {text}")
    return value


def _read_map(path: Path) -> NDArray[np.float64]:
    raster = read_raster(path)
    values = raster.color[..., 0].astype(np.float64)
    if not raster.is_float:
        values *= 4.0 / np.iinfo(raster.color.dtype).max
    return _check(values, f"tangent: the map {path}")


def _check(tangent: NDArray[np.float64], what: str) -> NDArray[np.float64]:
    wrong = ~((tangent >= FLATTEST) & (tangent <= STEEPEST))
    if wrong.any():
        row, column = np.argwhere(wrong)[0]
        i, j = (column + 0.5) / tangent.shape[1], (row + 0.5) / tangent.shape[0]
        raise FoliageError(
            f"{what} must be from {FLATTEST:g} to {STEEPEST:g} everywhere; at i = {i:.3f}, j = {j:.3f} it is "
            f"{tangent[row, column]:g}"
        )
    return np.ascontiguousarray(tangent)


def _evaluate(node: ast.expr, names: dict[str, NDArray[np.float64] | np.float64]) -> NDArray[np.float64] | np.float64:
    """Arithmetic only: nothing else of Python can be reached from a formula."""
    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            return np.float64(value)
        case ast.Name(id=name) if name in names:
            return names[name]
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -_evaluate(operand, names)
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            return _evaluate(operand, names)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
            return _BINARY[type(op)](_evaluate(left, names), _evaluate(right, names))
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in _FUNCTIONS:
            count, function = _FUNCTIONS[name]
            if len(arguments) != count:
                raise ValueError(f"{name} takes {count}, not {len(arguments)}")
            return function(*(_evaluate(argument, names) for argument in arguments))
    raise ValueError(f"{ast.unparse(node)} is not allowed")
