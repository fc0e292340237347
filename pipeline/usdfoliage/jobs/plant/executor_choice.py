"""Where the tasks of a build run; a module of its own, since the help of the commands needs it and little besides."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class ExecutorChoice:
    """Where tasks run."""

    jobs: int = 1  # processes of this machine; 1: this one
    scheduler: str = ""  # address of a Dask scheduler, instead
    threads: int = 0  # of a task; 0: one per core, shared among the processes

    def __post_init__(self) -> None:
        if self.jobs < 1:
            raise ValueError(f"jobs must be at least 1, not {self.jobs}")
        if self.threads < 0:
            raise ValueError(f"threads must be 0 or more, not {self.threads}")
        if self.scheduler and self.jobs > 1:
            raise ValueError("jobs are processes of this machine, and scheduler is Dask: name one of them")

    def describe(self) -> str:
        if self.scheduler:
            return f"by Dask at {self.scheduler}"
        return f"in {self.jobs} processes" if self.jobs > 1 else "in one process"
