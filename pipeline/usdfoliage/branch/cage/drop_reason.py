"""Why a branch is not in the cage."""

from enum import StrEnum


class DropReason(StrEnum):
    """The reasons; their values stand in model files."""

    NO_LENGTH = "no-length"
    TOO_SHORT = "too-short"
    COVERED = "covered"
    NO_ROOM = "no-room"
    CROSSES = "crosses"
    PARENT_DROPPED = "parent-dropped"
    AFLOAT = "afloat"
    TOO_MANY = "too-many"

    @property
    def text(self) -> str:
        """The reason after "a branch" or a number of branches."""
        return _TEXTS[self]


_TEXTS = {
    DropReason.NO_LENGTH: "without length",
    DropReason.TOO_SHORT: "too short to leave the surface of the parent",
    DropReason.COVERED: "shorter than the row of faces in which the parent ends",
    DropReason.NO_ROOM: "without room on the parent",
    DropReason.CROSSES: "crossing the parent or a neighbour",
    DropReason.PARENT_DROPPED: "on a parent that was dropped",
    DropReason.AFLOAT: "beside the surface of the parent",
    DropReason.TOO_MANY: "beyond the number of faces that the surface may have",
}
