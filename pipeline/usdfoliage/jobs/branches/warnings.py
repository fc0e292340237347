"""What puts an asset of branches in doubt, in sentences that say what to do about it."""

from usdfoliage.capture.cloud_files.units import UNITS

_PLANT_M = (0.05, 130.0)  # height of a plant: below it seedlings, above it none
_UNJOINED = 0.3  # share of the branches,
_FEW = 5  # of which so many may always be without a join
FEW_ROUND = 0.05  # share of the circles, from which on they are believed without a stem
_STEMS = 0.25  # share of the roots, from which on their stems are believed: of many in a hedge one looks like one
_REACHED = 0.7  # share of the points
_LONGER = 4  # times the internode, with which growth reaches points farther apart


def doubt_height(height_m: float, metres_per_unit: float) -> list[str]:
    """A doubt in the unit of a cloud whose plant is of no plant's height, with the units that give one.

    Args:
        height_m: Of the plant.
        metres_per_unit: That the height was taken by.
    """
    min_m, max_m = _PLANT_M
    if min_m <= height_m <= max_m:
        return []
    units = height_m / metres_per_unit
    heights_m = {name: units * size for name, size in UNITS.items()}
    likely = [f"--unit {name} ({own_m:.3g} m high)" for name, own_m in heights_m.items() if min_m <= own_m <= max_m]
    told = f"{1000 * height_m:.3g} mm" if height_m < min_m else f"{height_m:,.0f} m"
    what_to_do = (
        f"its unit is probably another one; say {' or '.join(likely)}" if likely else "look at the cloud's unit"
    )
    return [f"the plant is {told} high, {'lower' if height_m < min_m else 'higher'} than plants are: {what_to_do}"]


def doubt_stems(believed: float, stems: float, internode_m: float) -> list[str]:
    """A doubt in how thick branches are, and in branches at all of a cloud that shows no stems.

    Args:
        believed: Share of the circles that are.
        stems: Share of the roots that have a stem.
        internode_m: Of the branches.
    """
    if believed == 0:
        return ["no stem or branch of the cloud is round: how thick they are is a guess from their length"]
    if stems >= _STEMS or believed >= FEW_ROUND:
        return []
    return [
        "no stem is seen at a root, as in a hedge: how thick branches are is a guess, and many may be rows of leaves; "
        f"say --roots where stems are, or try --method grow with --internode {_LONGER * internode_m:.2g} or so"
    ]


def doubt_surface(branches: int, dropped: int, loose: int) -> list[str]:
    """A doubt in branches of which many could not be joined to the surface of their parents.

    Args:
        branches: Of the skeleton.
        dropped: That are in the skeleton alone.
        loose: That begin closed pieces of their own.
    """
    if dropped + loose <= max(_FEW, _UNJOINED * branches):
        return []
    return [
        f"{100 * (dropped + loose) / branches:.0f} % of the branches are not joined to the surface: the cloud shows "
        "few of them clearly; say --cloud-leaves on if leaves were taken for wood, or try --method grow"
    ]


def doubt_growth(reached: float, internode_m: float) -> list[str]:
    """A doubt in branches that grew through a part of the cloud alone.

    Args:
        reached: Share of the points that growth came to.
        internode_m: Of the growth.
    """
    if reached >= _REACHED:
        return []
    return [
        f"growth came to {100 * reached:.0f} % of the points alone: they are far apart for its internode, or no root "
        f"is near; say --internode {_LONGER * internode_m:.2g} or so, or more --roots"
    ]
