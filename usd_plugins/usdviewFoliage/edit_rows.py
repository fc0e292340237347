"""What can be moved of the edits: a row for each slider. A row may move several numbers by the same change."""

from dataclasses import dataclass

Part = tuple[str, int | None]  # of edits, and which of its three numbers


@dataclass(frozen=True)
class EditRow:
    """One slider."""

    group: str
    label: str
    parts: tuple[Part, ...]
    low: float
    high: float
    tip: str


def _vector(
    group: str, name: str, labels: tuple[str, str, str], size: float, tips: tuple[str, str, str]
) -> list[EditRow]:
    return [
        EditRow(group, label, ((name, number),), -size, size, tip)
        for number, (label, tip) in enumerate(zip(labels, tips, strict=True))
    ]


_AXIS = ("x", "y", "z")
_POINT = ("along", "out", "up")
_POINT_TIPS = ("along the axis", "away from the axis, on both halves", "out of the leaf's plane")

ROWS: tuple[EditRow, ...] = (
    EditRow("Shape", "width", (("width", None),), 0.0, 3.0, "factor on the width"),
    EditRow("Shape", "asymmetry x", (("axis1", 0), ("axis2", 0)), -0.5, 0.5, "moves the axis sideways"),
    EditRow("Shape", "asymmetry y", (("axis1", 1), ("axis2", 1)), -0.5, 0.5, "moves the axis' points along it"),
    EditRow("Shape", "bend", (("axis1", 2), ("axis2", 2)), -1.0, 1.0, "raises the axis out of the leaf's plane"),
    *_vector(
        "Curl", "curl", ("inner", "outer", "silhouette"), 0.5, ("raises the inner curve", "the outer", "the edge")
    ),
    EditRow("Jitter", "amplitude", (("jitter_amplitude", None),), 0.0, 0.2, "of the wave along the edge"),
    EditRow("Jitter", "frequency", (("jitter_frequency", None),), 0.5, 64.0, "waves from base to apex"),
    *_vector("Silhouette 1, near the base", "silhouette1", _POINT, 0.5, _POINT_TIPS),
    *_vector("Silhouette 2", "silhouette2", _POINT, 0.5, _POINT_TIPS),
    *_vector("Silhouette 3, near the apex", "silhouette3", _POINT, 0.5, _POINT_TIPS),
    *_vector("Axis 1, near the base", "axis1", _AXIS, 0.5, ("", "", "")),
    *_vector("Axis 2, near the apex", "axis2", _AXIS, 0.5, ("", "", "")),
)


def row_value(row: EditRow, edits: dict) -> float:
    """What a row shows: the mean of what it moves."""
    numbers = [edits[name] if number is None else edits[name][number] for name, number in row.parts]
    return sum(numbers) / len(numbers)


def with_row(row: EditRow, edits: dict, value: float) -> dict:
    """The edits with a row moved to a value; the numbers that it moves keep their differences."""
    change = value - row_value(row, edits)
    moved = dict(edits)
    for name, number in row.parts:
        if number is None:
            moved[name] = value
        else:
            numbers = list(moved[name])
            numbers[number] = value if len(row.parts) == 1 else numbers[number] + change
            moved[name] = tuple(numbers)
    return moved
