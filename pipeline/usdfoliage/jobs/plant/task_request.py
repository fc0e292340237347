"""What all that is made of tasks has in common, a plant as well as a forest."""

from pathlib import Path
from typing import Protocol, TypeVar

from usdfoliage.jobs.plant.store import Store


class TaskRequest(Protocol):
    """What is made: an asset of an input, with the results of its tasks in a work folder."""

    @property
    def capture(self) -> Path:
        """The input, a file or a folder."""

    @property
    def output(self) -> Path:
        """The folder of the asset."""

    @property
    def name(self) -> str:
        """Of the asset."""

    @property
    def store(self) -> Store:
        """Where results of tasks are."""


R = TypeVar("R", bound=TaskRequest)
