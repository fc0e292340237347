"""The sentences of the panel and the menu: one short sentence for each state."""

NO_PRODUCT = "Put usdfoliage on PATH to see the average leaf here."
NO_PLANT = "There is no plant of usdfoliage here."
HIDDEN = "The edits are hidden. Show them to change them."
EDITED = "The leaves are edited."
UNEDITED = "The leaves have no edits yet."
RESET = "All edits are taken back."
_GUIDES = {"Skeleton": "a skeleton", "Cloud": "a cloud", "Cameras": "cameras"}


def describe_look(look) -> tuple[bool, str]:
    """Whether the sliders act on the leaves of a LiveLook now, or of None, and the sentence of the panel's state."""
    if look is None:
        return False, NO_PLANT
    why_not = look.why_not()
    if why_not:
        return False, why_not
    if not look.is_visible():
        return False, HIDDEN
    return True, EDITED if look.is_edited() else UNEDITED


def describe_selection(name: str, chosen: str, count: int) -> str:
    """What selecting a variant did on so many plants."""
    if not count:
        return f"No plant has the {name} {chosen}."
    return f"{count} {'plant has' if count == 1 else 'plants have'} the {name} {chosen} now."


def describe_guide(name: str, visible: bool | None) -> str:
    """What became of the guides of a name; None where there are none."""
    if visible is None:
        return f"No plant has {_GUIDES[name]}."
    verb = "are" if name == "Cameras" else "is"
    return f"The {name.lower()} {verb} {'visible' if visible else 'hidden'} now."


def describe_saved(path: str, with_product: bool) -> str:
    """Where a look was written, and with which extents."""
    if with_product:
        return f"The look is saved: {path}"
    return f"The look is saved with wide extents, since usdfoliage does not answer: {path}"
