"""The kinds of plants that a forest has."""

from enum import StrEnum


class PlantKind(StrEnum):
    """Which ground a plant stands on, as the schema FoliageForestAPI names it."""

    TREE = "tree"
    SHRUB = "shrub"
    GRASS = "grass"


KINDS = tuple(kind.value for kind in PlantKind)
