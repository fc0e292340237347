"""Why photographs show no stems."""

from enum import Enum, auto


class NoStems(Enum):
    """Why photographs show no stems of a plant."""

    NOTHING_STANDS = auto()  # nothing of the cloud is above what the plant stands on
    TOO_THICK = auto()  # the thickest stem of the cloud is wider than a line may be
    FEW_PHOTOGRAPHS = auto()  # a line must be seen in two of them
    NO_LINES = auto()  # no thin line is seen in enough of them
    NOT_JOINED = auto()  # nothing that they show makes a stem from the soil up
