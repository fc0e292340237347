"""Reading properties as numpy arrays, whatever somebody has authored in them.

Values are those of the earliest time: shapes that the validators look at do not change over time. A value of another
type than the schema's counts as none; USD's own validator usdValidation:AttributeTypeMismatch reports it.
"""

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd


def is_authored(prim: Usd.Prim, name: str) -> bool:
    """Whether the property has a value of its own, blocked ones excluded."""
    attribute = prim.GetAttribute(name)
    return bool(attribute and attribute.HasAuthoredValue())


def value(prim: Usd.Prim, name: str) -> object:
    """The attribute's value, None where there is none."""
    attribute = prim.GetAttribute(name)
    return attribute.Get(Usd.TimeCode.EarliestTime()) if attribute else None


def numbers(prim: Usd.Prim, name: str, columns: int | None = None) -> NDArray[np.float64] | None:
    """An array attribute as (N,) or (N, columns); None where it has no such value."""
    found = value(prim, name)
    if found is None or isinstance(found, str | Sdf.AssetPath):
        return None
    array = np.asarray(found)
    shape_fits = array.ndim == 1 if columns is None else array.ndim == 2 and array.shape[1] == columns
    with np.errstate(invalid="ignore"):  # damaged files have numbers that are none
        return array.astype(np.float64) if shape_fits and array.dtype.kind in "fiu" else None


def indices(prim: Usd.Prim, name: str) -> NDArray[np.int64] | None:
    """An attribute int[] as (N,); None where it has no such value."""
    found = numbers(prim, name)
    if found is None or not np.isfinite(found).all() or (found != np.rint(found)).any():
        return None
    return found.astype(np.int64)


def tuple_of(prim: Usd.Prim, name: str, length: int) -> NDArray[np.float64] | None:
    """One vector attribute as (length,); None where it has no such value."""
    return numbers_of_shape(value(prim, name), (length,))


def number(prim: Usd.Prim, name: str) -> float | None:
    """One number; None where it has no such value."""
    found = value(prim, name)
    return float(found) if isinstance(found, int | float) and not isinstance(found, bool) else None


def texts(prim: Usd.Prim, name: str) -> list[str] | None:
    """An attribute string[] or token[]; None where it has no such value."""
    found = value(prim, name)
    if found is None or isinstance(found, str | int | float):
        return None
    elements = list(found) if hasattr(found, "__iter__") else [found]
    return elements if all(isinstance(element, str) for element in elements) else None


def asset_path(prim: Usd.Prim, name: str) -> Sdf.AssetPath | None:
    """An asset attribute; None where it is not authored or empty."""
    found = value(prim, name)
    return found if isinstance(found, Sdf.AssetPath) and found.path else None


def numbers_of_shape(content: object, shape: tuple[int, ...]) -> NDArray[np.float64] | None:
    """A vector or matrix value as an array of that shape; None for anything else."""
    if content is None or isinstance(content, str | Sdf.AssetPath):
        return None
    array = np.asarray(content)
    return array.astype(np.float64) if array.shape == shape and array.dtype.kind in "fiu" else None
