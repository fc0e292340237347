"""How far a build is."""

import time

from usdfoliage.jobs.plant.call import BuildRequest
from usdfoliage.jobs.plant.executors import Done, Wanted
from usdfoliage.progress import PlantProgress, Progress, StepProgress


class Meter:
    """How much of all the work is done: every plant has the same weight, its tasks weigh by their estimated time."""

    def __init__(self, plants: int, progress: PlantProgress | None) -> None:
        self._progress = progress
        self._plants = plants
        self._wanted: list[Wanted[BuildRequest]] = []
        self._done_s: dict[int, float] = {}  # of plants that are not at their end
        self._ended = 0

    def add(self, wanted: Wanted[BuildRequest]) -> None:
        self._done_s[len(self._wanted)] = 0.0
        self._wanted.append(wanted)

    def forget(self, place: int) -> None:
        """That plan counts no more: its plant is planned again."""
        self._done_s.pop(place, None)

    def end(self, place: int) -> None:
        self._done_s.pop(place, None)
        self._ended += 1

    def step(self, place: int, name: str) -> StepProgress | None:
        """What to call with the steps within a task, where it runs in this process."""
        if self._progress is None:
            return None
        report, plant = self._progress, self._wanted[place].request.name
        estimate_s, start_s = self._wanted[place].tasks[name].estimate_s, time.monotonic()

        def show(step: str, share: float) -> None:
            what = name if step == name else f"{name}: {step}"
            if step != name:
                # Steps follow each other within a task, and each counts from 0. The task as a whole is half done
                # after its estimate, and never done: a share that stood still would put its end ever farther off.
                taken_s = time.monotonic() - start_s
                share = taken_s / (taken_s + max(estimate_s, 1e-6))
            report(plant, what, self._share(place, name, share))

        return show

    def before(self, plant: str, name: str) -> Progress | None:
        """What to call with the parts of what comes before the tasks of a plant; of all the work it counts nothing."""
        if self._progress is None:
            return None
        report = self._progress
        return lambda done, total: report(plant, f"{name} {done / max(total, 1):.0%}", self._share(-1, "", 0.0))

    def done(self, place: int, done: Done) -> None:
        if place in self._done_s:
            self._done_s[place] += self._wanted[place].tasks[done.name].estimate_s
        if self._progress is not None:
            self._progress(self._wanted[place].request.name, done.name, self._share(place, done.name, 0.0))

    def _share(self, place: int, name: str, inner: float) -> float:
        total = float(self._ended)
        for each, done_s in self._done_s.items():
            tasks = self._wanted[each].tasks
            more_s = inner * tasks[name].estimate_s if each == place else 0.0
            total += (done_s + more_s) / (sum(task.estimate_s for task in tasks.values()) or 1.0)
        return total / max(self._plants, 1)
