"""Axes that point up, and the rotation that makes such an axis Y."""

import numpy as np
from numpy.typing import NDArray

AXES = ("+X", "-X", "+Y", "-Y", "+Z", "-Z")
_SMALLEST = 1e-24  # square of a sine that is taken for 0
_UNIT = 1e-9  # by which the length of a direction may differ from 1


def turn_to_y_up(axis: NDArray[np.floating]) -> NDArray[np.float64]:
    """The rotation (3, 3) that turns a world with this direction up to Y up: x_in_y_up = rotation @ x_in_world.

    Of the rotations that do so the one by the smallest angle; for -Y, that about X. For +Z it gives (x, z, -y). Those
    of ±X, ±Y, ±Z hold whole numbers only.

    Args:
        axis: (3,), of length 1.

    Raises:
        ValueError: axis is of another shape or length.
    """
    axis = np.asarray(axis, np.float64)
    if axis.shape != (3,) or not abs(float(np.linalg.norm(axis)) - 1) <= _UNIT:
        raise ValueError(f"axis must be a direction of length 1, such as one of ±X, ±Y, ±Z, not {axis}")
    y = np.array([0.0, 1.0, 0.0])
    square = float(axis[0] ** 2 + axis[2] ** 2)  # of the sine of the angle between the two
    if square < _SMALLEST:  # then the smallest turn to Y, or from -Y, is about no one axis
        return np.diag([1.0, np.sign(axis[1]), np.sign(axis[1])])
    across = np.cross(axis, y)
    if axis[1] == 0:
        # About what is across both by a quarter turn: it stays, axis goes to y and y to -axis.
        return np.outer(across, across) + np.outer(y, axis) - np.outer(axis, y) + 0.0
    skew = np.array([[0, -across[2], across[1]], [across[2], 0, -across[0]], [-across[1], across[0], 0]])
    # Near -Y the sum 1 + cos has lost all its digits.
    beyond = square / (1 - axis[1]) if axis[1] < 0 else 1 + axis[1]
    return np.asarray(np.eye(3) + skew + skew @ skew / beyond)  # Rodrigues' formula


def axis_vector(name: str) -> NDArray[np.float64]:
    """(3,), unit, for X, Y or Z with or without + or -."""
    axis = parse_axis(name)
    vector = np.zeros(3)
    vector["XYZ".index(axis[1])] = 1.0 if axis[0] == "+" else -1.0
    return vector


def parse_axis(name: str) -> str:
    """The same axis with its sign; ValueError for what is none."""
    axis = name.strip().upper()
    axis = axis if axis[:1] in ("+", "-") else f"+{axis}"
    if axis not in AXES:
        raise ValueError(f"an axis is X, Y or Z, or one with + or -, not {name!r}")
    return axis
