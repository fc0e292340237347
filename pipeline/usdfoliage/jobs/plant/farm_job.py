"""What a farm gets: the steps of a build, and the parameters that whoever submits it may change."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # a help, which needs the defaults alone, loads no stage
    from usdfoliage.jobs.plant.steps import Step


MAX_PARAMETERS = 50  # of a template of Open Job Description, with the executable


@dataclass(frozen=True, kw_only=True)
class JobParameter:
    """What whoever submits the job may change."""

    name: str
    kind: str  # STRING, INT, FLOAT or PATH
    value: str | int | float | None  # None: not known yet
    description: str
    option: str = ""  # of the command, before the value; empty: the value alone
    is_file: bool = False  # a PATH's
    flow: str = ""  # a PATH's: IN, OUT or INOUT


@dataclass(frozen=True, kw_only=True)
class FarmJob:
    """A build on a farm."""

    name: str  # of the asset
    steps: Sequence["Step"]
    parameters: Sequence[JobParameter]
    flags: Sequence[str] = ()  # of the last step, which puts the asset in its place
    switches: Sequence[str] = ()  # options without a value, of all steps
    what: str = "plant"  # that is made
    command: str = "task"  # of usdfoliage, that does a step
    heavy: Sequence[str] = ()  # stages that need a heavy machine, besides those of plants
    executable: str = "usdfoliage"
    cores: int = 4  # of a machine that does heavy steps
    memory_mib: int = 8192  # likewise
    is_chunked: bool = True  # whether the farm may give several chunks to one command

    def __post_init__(self) -> None:
        if self.cores < 1:
            raise ValueError(f"cores must be at least 1, not {self.cores}")
        if self.memory_mib < 1:
            raise ValueError(f"memory-mib must be at least 1, not {self.memory_mib}")
        if len(self.parameters) >= MAX_PARAMETERS:
            raise ValueError(f"parameters of a job are at most {MAX_PARAMETERS - 1}, not {len(self.parameters)}")
