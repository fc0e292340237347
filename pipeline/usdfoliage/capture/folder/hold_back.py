"""Photographs that are withheld: nothing of an asset is made of them, and so they can judge it."""

from collections.abc import Sequence

from usdfoliage.capture.folder.listing import counted
from usdfoliage.errors import CaptureError
from usdfoliage.remarks import Setting

FIRST = 2  # the third photograph: the first two stay, which a small capture cannot do without
_CLOSEST = 2  # apart: of every photograph, none would be left


def check_hold_back(every: int) -> None:
    """Raises ValueError for a number that is neither 0, for none, nor 2 or more."""
    if every != 0 and every < _CLOSEST:
        raise ValueError(f"hold_back must be 0 or at least {_CLOSEST}, not {every}")


def choose_withheld(names: Sequence[str], every: int) -> tuple[str, ...]:
    """The photographs that are withheld: of the sorted names every so many, from the third on.

    Args:
        names: Of all photographs, in any order.
        every: 2 or more; 0 holds nothing back.

    Raises:
        CaptureError: There are no three photographs, and so none to hold back.
    """
    check_hold_back(every)
    if not every:
        return ()
    withheld = tuple(sorted(names)[FIRST::every])
    if not withheld:
        raise CaptureError(
            f"no photograph can be withheld: there are {counted(len(names), 'photograph')}, and it takes "
            f"{FIRST + 1} at least",
            ("add photographs, or set ", Setting(name="plant.hold_back", value="0")),
        )
    return withheld
