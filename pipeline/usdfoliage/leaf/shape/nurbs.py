"""The leaf as a NURBS patch, and back: a patch that a modeller changed read as a leaf again."""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from usdfoliage.errors import FitError
from usdfoliage.leaf.shape.surface import evaluate_jacobian, evaluate_points, grid_places

# The patch is the leaf exactly: a cubic in u for either half, which meet at u = 0, and a quartic in v. Its control
# points are those of usdfoliage.leaf.shape.surface.leaf_nets, u fastest.
U_ORDER, V_ORDER = 4, 5  # degree + 1
U_KNOTS = (-1.0,) * 4 + (0.0,) * 3 + (1.0,) * 4
V_KNOTS = (0.0,) * 5 + (1.0,) * 5

SHAPE = (5, 7, 3)  # of a net
APEX = np.array([0.0, 1.0, 0.0])  # in leaf space; the base is the origin
SAMPLES = grid_places(np.linspace(-1, 1, 13), np.linspace(0, 1, 9))  # (P, 2), where patch and leaf are compared
REACH = (-0.25, 1.25)  # where on the axis silhouettes may be anchored
MIN_LENGTH = 1e-6  # of the patch's extent: shorter, base and apex are one point
MIN_WIDTH = 1e-6  # of the length: narrower, no side is up
FOLD_RESIDUAL = 1e-3  # of the length: a leaf this near to the patch is what it was drawn as, folded or not


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedLeaf:
    """The leaf nearest to a patch, and where it is; lengths in the unit of the patch."""

    parameters: NDArray[np.float64]  # (7, 3)
    base_m: NDArray[np.float64]  # (3,)
    orientation: NDArray[np.float64]  # (4,), unit quaternion (x, y, z, w), patch from leaf
    length_m: float
    residual_m: float  # root mean square distance between points of the same (u, v)


def net_weights(uv: NDArray[np.float64]) -> NDArray[np.float64]:
    """What each of a net's 35 control points, u fastest, contributes to the surface at uv (P, 2): (P, 35)."""
    across = scipy.interpolate.BSpline.design_matrix(uv[:, 0], np.array(U_KNOTS), U_ORDER - 1).toarray()
    along = scipy.interpolate.BSpline.design_matrix(uv[:, 1], np.array(V_KNOTS), V_ORDER - 1).toarray()
    return np.asarray(np.einsum("pv,pu->pvu", along, across)).reshape(len(uv), -1)


def fit_leaf(net: NDArray[np.floating]) -> FittedLeaf:
    """The leaf, anywhere and of any size, that is nearest to a patch in the mean square over (u, v).

    A net of a leaf, moved, turned and scaled equally along all axes, gives that leaf exactly. Base and apex are those
    of the patch, the means of its first and its last row.

    Args:
        net: (5, 7, 3), rows from base to apex, columns from left to right.

    Raises:
        ValueError: net is not (5, 7, 3).
        FitError: The net is not finite, base and apex are one point, the patch has no width, or it folds over itself
            and is not a leaf.
    """
    points = np.asarray(net, np.float64)
    if points.shape != SHAPE:
        raise ValueError(f"net must be {SHAPE}, not {points.shape}")
    if not np.isfinite(points).all():
        raise FitError(f"{np.sum(~np.isfinite(points))} coordinates of the patch are not finite")
    base, apex = points[0].mean(axis=0), points[-1].mean(axis=0)
    extent = float(np.linalg.norm(np.ptp(points.reshape(-1, 3), axis=0)))
    length = float(np.linalg.norm(apex - base))
    if length <= MIN_LENGTH * extent:
        raise FitError(
            f"base and apex of the patch are {length:.3g} apart, {MIN_LENGTH * extent:.3g} at least are needed",
            "part the first row of control points from the last one",
        )
    patch_from_leaf = _frame(points, (apex - base) / length, length)
    in_leaf = (points - base) @ patch_from_leaf / length

    target = net_weights(SAMPLES) @ in_leaf.reshape(-1, 3)
    start = np.append(_read_net(in_leaf), 0.0)
    solution = scipy.optimize.least_squares(
        _differences, start, _derivatives, method="lm", xtol=1e-15, ftol=1e-15, args=(target,)
    )
    parameters, roll = solution.x[:-1].reshape(7, 3), solution.x[-1]
    residual = float(np.sqrt(np.mean(np.sum(solution.fun.reshape(-1, 3) ** 2, axis=1))))
    if residual > FOLD_RESIDUAL and not np.all(np.diff(parameters[2:5, 0]) > 0):
        v1, v2, v3 = parameters[2:5, 0]
        raise FitError(
            f"the patch folds over itself: along the nearest leaf its rows lie at v = {v1:.3f}, {v2:.3f}, {v3:.3f}, "
            f"and rising numbers are needed; it is {residual:.3f} lengths from any leaf"
        )
    turned = patch_from_leaf @ _about_axis(roll)
    return FittedLeaf(
        parameters=parameters,
        base_m=base,
        orientation=scipy.spatial.transform.Rotation.from_matrix(turned).as_quat(),
        length_m=length,
        residual_m=residual * length,
    )


def _frame(points: NDArray[np.float64], along: NDArray[np.float64], length: float) -> NDArray[np.float64]:
    """Columns x, y and z of leaf space: x where the right half lies, as far as it can be at right angles to y."""
    across = points[1:-1, 6] - points[1:-1, 0]
    across = across - across @ along[:, None] * along
    # Of a leaf all three are parallel; otherwise the direction nearest to them.
    nearest = np.linalg.svd(across)[2][0]
    nearest *= 1.0 if np.sum(across @ nearest) >= 0 else -1.0
    width = float(np.abs(across @ nearest).max())
    if width <= MIN_WIDTH * length:
        raise FitError(
            f"the patch is {width:.3g} wide, {MIN_WIDTH * length:.3g} at least are needed",
            "draw its left and right silhouettes apart",
        )
    return np.column_stack([nearest, along, np.cross(nearest, along)])


def _read_net(net: NDArray[np.float64]) -> NDArray[np.float64]:
    """The 21 parameters of a net in leaf space; exact for a leaf's, a start for a fit otherwise."""
    # The axis is a cubic raised to degree four, the axis points in rows 1 to 3.
    raised = np.array([[0.75, 0.0], [0.5, 0.5], [0.0, 0.75]])
    axis = np.linalg.lstsq(raised, net[1:-1, 3] - np.outer([0, 0, 0.25], APEX), rcond=None)[0]
    cubic = np.array([APEX + 3 * (axis[0] - axis[1]), 3 * axis[1] - 6 * axis[0], 3 * axis[0], np.zeros(3)])
    parameters = np.empty((7, 3))
    parameters[:2] = axis
    for row in range(3):
        left, right = net[row + 1, 0], net[row + 1, 6]
        place = _nearest_on_axis(cubic[:, :2], ((left + right) / 2)[:2])
        height = np.polyval(cubic[:, 2], place)
        tangent = np.array([np.polyval(np.polyder(cubic[:, k]), place) for k in (0, 1)])
        normal = np.array([tangent[1], -tangent[0]]) / max(float(np.linalg.norm(tangent)), 1e-12)
        parameters[2 + row] = place, normal @ (right - left)[:2] / 2, (left + right)[2] / 2 - height
        for curve, column in ((5, 1), (6, 2)):
            parameters[curve, row] = (net[row + 1, 3 - column] + net[row + 1, 3 + column])[2] / 2 - height
    return parameters.reshape(-1)


def _nearest_on_axis(cubic: NDArray[np.float64], point: NDArray[np.float64]) -> float:
    """v where a plane cubic (4, 2), highest power first, is nearest to a point; not far beyond base and apex."""
    x, y = cubic[:, 0] - (0, 0, 0, point[0]), cubic[:, 1] - (0, 0, 0, point[1])
    distance = np.polyadd(np.polymul(x, x), np.polymul(y, y))
    roots = np.roots(np.polyder(distance))
    # Beyond its ends the cubic turns back and may meet the point again.
    places = np.append(roots[np.abs(roots.imag) < 1e-6].real.clip(*REACH), REACH)
    return float(places[np.argmin(np.polyval(distance, places))])


def _about_axis(roll: float) -> NDArray[np.float64]:
    c, s = np.cos(roll), np.sin(roll)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def _differences(unknown: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """Leaf minus patch at the samples, (3 P,), for 21 parameters and the roll about base and apex."""
    leaf = evaluate_points(unknown[:-1].reshape(1, 7, 3), SAMPLES)[0]
    return (leaf - target @ _about_axis(unknown[-1])).reshape(-1)


def _derivatives(unknown: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """Their derivatives: (3 P, 22)."""
    _, by_parameters = evaluate_jacobian(unknown[:-1].reshape(1, 7, 3), SAMPLES)
    c, s = np.cos(unknown[-1]), np.sin(unknown[-1])
    turning = np.array([[-s, 0, c], [0, 0, 0], [-c, 0, -s]])
    return np.column_stack([by_parameters[0].reshape(-1, 21), -(target @ turning).reshape(-1)])
