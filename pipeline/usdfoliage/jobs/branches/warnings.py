"""Checks of an asset of branches: each returns a list of warnings with their remedies, empty where all is well."""

from usdfoliage.capture.cloud_files.units import UNITS
from usdfoliage.remarks import Remark, Remedy, Setting, remark

_PLANT_M = (0.05, 130.0)  # height of a plant: below it seedlings, above it none
_UNJOINED = 0.3  # share of the branches,
_FEW = 5  # of which so many may always be without a join
FEW_ROUND = 0.05  # share of the circles, from which on they are believed without a stem
_STEMS = 0.25  # share of the roots, from which on their stems are believed: of many in a hedge one looks like one
_REACHED = 0.7  # share of the points
_LONGER = 4  # times the internode, with which growth reaches points farther apart

_GROW = "try the method grow of usdfoliage branches"


def check_height(height_m: float, metres_per_unit: float) -> list[Remark]:
    """A warning where a cloud's plant is of no plant's height, with the units that give one.

    Args:
        height_m: Of the plant.
        metres_per_unit: The unit that the height was taken by.
    """
    min_m, max_m = _PLANT_M
    if min_m <= height_m <= max_m:
        return []
    heights_m = {name: height_m / metres_per_unit * size for name, size in UNITS.items()}
    likely = {name: own_m for name, own_m in heights_m.items() if min_m <= own_m <= max_m}
    remedy: Remedy = ("look at the cloud's unit",)
    if likely:
        units = [
            (Setting(name="capture.toml:metres_per_unit", value=f"{UNITS[name]:g}"), f" ({own_m:.3g} m high)")
            for name, own_m in likely.items()
        ]
        others = (part for unit in units[1:] for part in (" or ", *unit))
        remedy = ("its unit is probably another one; give ", *units[0], *others)
    height = f"{1000 * height_m:.3g} mm" if height_m < min_m else f"{height_m:,.0f} m"
    text = f"the plant is {height} high, {'lower' if height_m < min_m else 'higher'} than plants are"
    return [remark("plant-height-improbable", text, remedy=remedy)]


def check_stems(believed: float, stems: float, internode_m: float) -> list[Remark]:
    """A warning where a cloud shows no round branch, or neither these nor stems.

    Args:
        believed: Share of the circles that are believed.
        stems: Share of the roots that have a stem.
        internode_m: Of the branches.
    """
    if believed == 0:
        text = "no stem or branch of the cloud is round; how thick they are is estimated from their length"
        return [remark("branches-not-round", text)]
    if stems >= _STEMS or believed >= FEW_ROUND:
        return []
    return [
        remark(
            "stems-not-seen",
            "no stem is seen at a root, as in a hedge; how thick branches are is estimated, and many may be rows of "
            "leaves",
            remedy=(
                "give ",
                Setting(name="branches.roots"),
                f" where stems are, or {_GROW} with an internode of {_LONGER * internode_m:.2g} m or so",
            ),
        )
    ]


def check_surface(branches: int, dropped: int, loose: int) -> list[Remark]:
    """A warning where many branches could not be joined to the surface of their parents.

    Args:
        branches: Of the skeleton.
        dropped: That are in the skeleton alone.
        loose: That begin closed pieces of their own.
    """
    if dropped + loose <= max(_FEW, _UNJOINED * branches):
        return []
    share = 100 * (dropped + loose) / branches
    return [
        remark(
            "branches-not-joined",
            f"{share:.0f} % of the branches are not joined to the surface; the cloud shows few of them clearly",
            remedy=(
                "give ",
                Setting(name="branches.cloud_leaves", value='"on"'),
                f" if leaves were taken for wood, or {_GROW}",
            ),
        )
    ]


def check_growth(reached: float, internode_m: float) -> list[Remark]:
    """A warning where branches grew through a part of the cloud alone.

    Args:
        reached: Share of the points that growth came to.
        internode_m: Of the growth.
    """
    if reached >= _REACHED:
        return []
    return [
        remark(
            "growth-incomplete",
            f"growth came to {100 * reached:.0f} % of the points alone; they are far apart for its internode, or no "
            "root is near",
            remedy=(
                "give ",
                Setting(name="branches.internode_m", value=f"{_LONGER * internode_m:.2g}"),
                " or so, or more ",
                Setting(name="branches.roots"),
            ),
        )
    ]
