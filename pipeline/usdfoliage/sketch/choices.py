"""What somebody chose for a tree beside its strokes: kept with them, so that they give the same tree again."""

import math
from dataclasses import dataclass, fields
from typing import Any

_LARGEST = 2**53  # beyond it a number of JSON is not exact


@dataclass(frozen=True, kw_only=True)
class SketchChoices:
    """Values of a drawing; None where nobody chose, which is the default then."""

    height_m: float | None = None  # from the root to the top
    depth: float | None = None  # times as deep as the silhouette has it
    density: float | None = None  # times as many leaves
    gravity: float | None = None  # -1 to 1: how far new shoots hang
    leaf_length_m: float | None = None
    seed: int | None = None

    def over(self, other: "SketchChoices") -> "SketchChoices":
        """These, and those of another where nothing was chosen here."""
        merged = {
            each.name: getattr(other, each.name) if getattr(self, each.name) is None else getattr(self, each.name)
            for each in fields(self)
        }
        return SketchChoices(**merged)

    @property
    def table(self) -> dict[str, float]:
        """What was chosen, as JSON has it."""
        return {each.name: value for each in fields(self) if (value := getattr(self, each.name)) is not None}


def parse_choices(table: Any) -> SketchChoices:
    """Choices as JSON has them; their ranges are checked where they are used.

    Raises:
        ValueError: It is no table of such numbers.
    """
    if not isinstance(table, dict):
        raise ValueError(f"settings must be a table, not {table!r:.60}")
    names = [each.name for each in fields(SketchChoices)]
    if unknown := sorted(set(table) - set(names)):
        raise ValueError(f"settings has no {unknown[0]!r:.60}; it may have {', '.join(names)}")
    for name, value in table.items():
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number or not math.isfinite(value) or abs(value) >= _LARGEST:
            raise ValueError(f"{name} of settings must be a number, not {value!r:.60}")
        if name == "seed" and not isinstance(value, int):
            raise ValueError(f"seed of settings must be a whole number, not {value!r:.60}")
    return SketchChoices(**table)
