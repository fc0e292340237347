"""Every code that a remark can have: what it means, and what to do. The input guide's tables are made of it."""

from collections.abc import Mapping
from dataclasses import dataclass

SEVERITIES = ("warning", "info")


@dataclass(frozen=True, kw_only=True)
class RemarkKind:
    """What remarks of one code have in common."""

    severity: str  # one of SEVERITIES
    meaning: str  # one or two short sentences
    action: str  # what to do; "nothing" with the reason where there is nothing to do


@dataclass(frozen=True, kw_only=True)
class RemarkSection:
    """A table of the input guide."""

    title: str
    kinds: Mapping[str, RemarkKind]  # by code: lower case, words joined by "-"


SECTIONS: tuple[RemarkSection, ...] = (
    RemarkSection(
        title="Branches",
        kinds={
            "plant-height-improbable": RemarkKind(
                severity="warning",
                meaning="The plant is lower than 5 cm or higher than 130 m. Its unit is probably wrong.",
                action="Give the unit that the remark names.",
            ),
        },
    ),
)

REMARK_KINDS: Mapping[str, RemarkKind] = {code: kind for section in SECTIONS for code, kind in section.kinds.items()}
