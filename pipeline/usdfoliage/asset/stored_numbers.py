"""Numbers in layers that others worked on: USD returns the value of the strongest layer, of whatever type it is."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def stored_numbers(value: object, shape: Sequence[int | None]) -> NDArray[np.float64] | None:
    """A value of USD as float64 of that shape; None where it is missing, no numbers, or of another shape.

    Args:
        value: What an attribute holds.
        shape: () for a single number; None stands for any length.
    """
    if value is None:
        return None
    array = np.asarray(value)
    if array.dtype.kind not in "iuf" or array.ndim != len(shape):
        return None
    if any(needed is not None and length != needed for length, needed in zip(array.shape, shape, strict=True)):
        return None
    return array.astype(np.float64)
