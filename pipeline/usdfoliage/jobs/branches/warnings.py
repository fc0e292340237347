"""Checks of an asset of branches: each returns a list of warnings with their remedies, empty where all is well."""

from collections.abc import Mapping

from usdfoliage.remarks import Remark, Setting, remark

_UNJOINED = 0.3  # share of the branches,
_FEW = 5  # of which so many may always be without a join
FEW_ROUND = 0.05  # share of the circles, from which on they are believed without a stem
_STEMS = 0.25  # share of the roots, from which on their stems are believed: of many in a hedge one looks like one
REACHED = 0.95  # share of the points, to which growth comes at least
_NAMED = 5  # variations that a remark names; it counts the others
_LONGER = 4  # times the internode, with which growth reaches points farther apart

NO_STEMS = "stems-not-seen"  # the code of the remark of check_stems

_GROW = Setting(name="branches.method", value='"grow"')


def check_stems(believed: float, stems: float, internode_m: float, grows: bool = False) -> list[Remark]:
    """A warning where a cloud shows no round branch, or neither these nor stems.

    Args:
        believed: Share of the circles that are believed.
        stems: Share of the roots that have a stem.
        internode_m: Of the branches.
        grows: Whether they grow through the cloud already.
    """
    if believed == 0:
        text = "no stem or branch of the cloud is round; how thick they are is estimated from their length"
        return [remark("branches-not-round", text)]
    if stems >= _STEMS or believed >= FEW_ROUND:
        return []
    longer = Setting(name="branches.internode_m", value=f"{_LONGER * internode_m:.2g}")
    return [
        remark(
            "stems-not-seen",
            "no stem is seen at a root, as in a hedge; how thick branches are is estimated, and many may be rows of "
            "leaves",
            remedy=(
                "give ",
                Setting(name="branches.roots"),
                " where stems are",
                *(() if grows else (", or ", _GROW, " with ", longer, " or so")),
            ),
        )
    ]


def check_surface(branches: int, dropped: int, loose: int, grows: bool = False) -> list[Remark]:
    """A warning where many branches could not be joined to the surface of their parents.

    Args:
        branches: Of the skeleton.
        dropped: That are in the skeleton alone.
        loose: That begin closed pieces of their own.
        grows: Whether they grow through the cloud already.
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
                " if leaves were taken for wood",
                *(() if grows else (", or ", _GROW)),
            ),
        )
    ]


def check_faces(branches: int, beyond: int) -> list[Remark]:
    """A warning where many branches are left out for the number of faces.

    Args:
        branches: Of the skeleton.
        beyond: That the surface would have too many faces with.
    """
    if beyond <= max(_FEW, _UNJOINED * branches):
        return []
    text = f"{100 * beyond / branches:.0f} % of the branches are left out, since the surface would have too many faces"
    remedy = ("give ", Setting(name="branches.max_faces"), ", or a cloud of the plant alone")
    return [remark("branches-beyond-faces", text, remedy=remedy)]


def check_growth(reached: float, internode_m: float) -> list[Remark]:
    """A warning where branches grew through a part of the cloud alone.

    Args:
        reached: Share of the points that growth came to.
        internode_m: Of the growth.
    """
    if reached >= REACHED:
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


def check_variations(reached: Mapping[int, float]) -> list[Remark]:
    """A warning where variations grew through a part of their envelopes alone.

    Args:
        reached: By the number of the variation, the share of the points of its own envelope that it came to.
    """
    short = {number: share for number, share in sorted(reached.items()) if share < REACHED}
    if not short:
        return []
    # Rounded down: 94.97 % is not 95 %.
    named = [f"{int(1000 * share) / 10:.1f} % (number {number})" for number, share in [*short.items()][:_NAMED]]
    others = f" and {len(short) - _NAMED} others" if len(short) > _NAMED else ""
    return [
        remark(
            "variations-incomplete",
            f"{len(short)} of {len(reached)} variations grew to less than {100 * REACHED:.0f} % of the points of their "
            f"envelopes, {', '.join(named)}{others}; parts of their crowns may be empty",
            remedy=("give a lower ", Setting(name="branches.variation_spread"), ", or do not use them"),
        )
    ]


def check_motion(sways: bool, grows: bool, whose: str = "the plant") -> list[Remark]:
    """Warnings where branches without a surface are to move.

    Args:
        sways: Whether a rig or a sway was asked for.
        grows: Whether growth was asked for.
        whose: They are.
    """
    remarks = []
    if sways:
        text = f"{whose} does not sway: it has no branches that joints could turn"
        remarks.append(remark("sway-without-branches", text))
    if grows:
        remarks.append(remark("growth-without-branches", f"{whose} does not grow: it has no branches"))
    return remarks
