"""How far leaves may reach under edits, found without drawing one.

The box is wider than that of usdfoliage.leaf.shape.bounds, which knows the surface: here only the greatest of each
parameter is known, so that a slider can be followed with a hundred thousand leaves.
"""

from dataclasses import dataclass

from pxr import Gf, Usd, UsdGeom

Range = tuple[float, float]
ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class LeavesRange:
    """Smallest and largest value of every parameter of many leaves, and where these are."""

    parameters: dict[str, tuple[Range, Range, Range]]  # by name, of each of the three numbers
    positions: Gf.Range3d
    max_scale: float


def read_range(instancer: Usd.Prim) -> LeavesRange | None:
    """What is known of the leaves of an instancer; None for no leaves."""
    times = UsdGeom.PointInstancer(instancer).GetPositionsAttr()
    time = Usd.TimeCode.Default() if times.Get() is not None else Usd.TimeCode.EarliestTime()
    positions, scales = times.Get(time), instancer.GetAttribute("scales").Get(time)
    if not positions or not scales:
        return None
    parameters = {}
    for name in ("axis1", "axis2", "silhouette1", "silhouette2", "silhouette3", "inner", "outer"):
        numbers_of_leaves = instancer.GetAttribute(f"primvars:leaf:{name}").Get(time)
        if not numbers_of_leaves:
            return None
        parameters[name] = tuple((min(numbers), max(numbers)) for numbers in zip(*numbers_of_leaves, strict=True))
    low, high = (Gf.Vec3d(*(pick(numbers) for numbers in zip(*positions, strict=True))) for pick in (min, max))
    return LeavesRange(parameters, Gf.Range3d(low, high), max(max(scale) for scale in scales))


def box_in_leaf_space(leaves: LeavesRange, edits: dict) -> Gf.Range3d:
    """A box that holds every edited leaf in leaf space: it holds all control points, in whose hull a leaf lies."""

    def max_size(name: str, component: int, added: float = 0.0, factor: float = 1.0) -> float:
        return max(abs(factor * end + added) for end in leaves.parameters[name][component])

    width, curl = edits.get("width", 1.0), edits.get("curl", ZERO)
    axis = [[max_size(name, k, edits.get(name, ZERO)[k]) for k in range(3)] for name in ("axis1", "axis2")]
    # Where a silhouette point is on the axis, and the most that the axis' weights come to there.
    places = [
        end + edits.get(f"silhouette{i}", ZERO)[0] for i in (1, 2, 3) for end in leaves.parameters[f"silhouette{i}"][0]
    ]
    beyond = max(1.0, *(max(abs(v), abs(1 - v)) for v in places))
    apex = (0.0, 1.0, 0.0)
    on_axis = [
        max(axis[0][k], axis[1][k], apex[k]) if beyond == 1 else beyond**3 * (3 * axis[0][k] + 3 * axis[1][k] + apex[k])
        for k in range(3)
    ]
    across = max(max_size(f"silhouette{i}", 1, edits.get(f"silhouette{i}", ZERO)[1], width) for i in (1, 2, 3))
    across += edits.get("jitter_amplitude", 0.0)
    up = max(
        *(max_size(f"silhouette{i}", 2, edits.get(f"silhouette{i}", ZERO)[2] + curl[2]) for i in (1, 2, 3)),
        *(max_size("inner", k, curl[0]) for k in range(3)),
        *(max_size("outer", k, curl[1]) for k in range(3)),
    )
    reach = Gf.Vec3d(on_axis[0] + across, on_axis[1] + across, on_axis[2] + up)
    return Gf.Range3d(-reach, reach)


def box_among_leaves(leaves: LeavesRange, in_leaf_space: Gf.Range3d) -> Gf.Range3d:
    """A box that holds all leaves in the space of their instancer, however each is turned."""
    reach = Gf.Vec3d(leaves.max_scale * in_leaf_space.max.GetLength())
    return Gf.Range3d(leaves.positions.min - reach, leaves.positions.max + reach)
