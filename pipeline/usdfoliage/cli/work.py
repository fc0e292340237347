"""List the work folder of builds, and remove the results that no build needs.

Results are needed if the latest build of a plant uses them; a plant is a capture and its output. The planes of matching
are not needed when their depth is done. Results of other settings, photographs or versions, and of killed runs, are not
needed. A build makes removed results again when it needs them.

While a task of a plant runs, nothing of that plant is removed. Nothing outside the folder is ever removed.
"""

import argparse
import os
from collections.abc import Iterable
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from usdfoliage.files.write_gate import Access
from usdfoliage.jobs.plant.work_folder import BESIDE_ASSET, WORK_VARIABLE

if TYPE_CHECKING:
    from usdfoliage.jobs.plant.prune import StoredTask


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument_group("input and output").add_argument(
        "folder",
        type=Path,
        nargs="?",
        metavar="FOLDER",
        help="This is the folder that builds have in --work; the default is the folder in "
        f"${WORK_VARIABLE}. Builds without either have {BESIDE_ASSET} beside the asset.",
    )
    run_options = parser.add_argument_group("this run")
    run_options.add_argument("--prune", action="store_true", help="Remove the results that are not needed.")
    run_options.add_argument(
        "--dry-run", action="store_true", help="With --prune, only print what would be removed. Nothing is removed."
    )
    run_options.add_argument(
        "--keep-days",
        type=float,
        default=0.0,
        metavar="DAYS",
        help="Results that were used in so many days stay, 0 or more; the default is %(default)g.",
    )


def declare(options: argparse.Namespace) -> Access:
    return Access()  # it removes results of builds from their own folder, and nothing else


def run(options: argparse.Namespace) -> int:
    from usdfoliage.errors import FoliageError
    from usdfoliage.jobs.plant.prune import prune_work, survey_work

    if not options.keep_days >= 0:
        raise FoliageError(f"--keep-days must be 0 or more, not {options.keep_days:g}")
    if options.dry_run and not options.prune:
        raise FoliageError("--dry-run lists what --prune would remove", "add --prune")
    folder = _find_folder(options.folder)
    stored = survey_work(folder, options.keep_days)
    if not options.prune:
        print(_as_table(stored))
        spare = sum(task.size_bytes for task in stored if task.state == "not needed")
        print(f"{folder}: {_size(stored)}, {_megabytes(spare)} not needed (--prune removes that)")
        return 0
    if options.dry_run:
        removed = tuple(task for task in stored if task.state == "not needed")
    else:
        removed = prune_work(folder, options.keep_days)
    if removed:
        print(_as_table(removed))
    print(f"{folder}: {_size(removed)} {'would be ' if options.dry_run else ''}removed")
    return 0


def _find_folder(given: Path | None) -> Path:
    """The work folder that is meant, as builds find theirs; FoliageError where nothing names one."""
    from usdfoliage.errors import FoliageError

    if given is not None:
        return given
    named = os.environ.get(WORK_VARIABLE)
    if not named:
        raise FoliageError(
            f"no work folder is named: give FOLDER, or set {WORK_VARIABLE}; builds without have theirs, .usdfoliage, "
            "beside the asset"
        )
    return Path(named).absolute()


def _as_table(stored: Iterable["StoredTask"]) -> str:
    """A line for all tasks of one kind, capture and state."""
    groups: dict[tuple[str, str, str], list[StoredTask]] = {}
    for task in stored:
        groups.setdefault((task.capture or "(unknown)", task.stage, task.state), []).append(task)
    rows = [("capture", "task", "count", "size", "last used", "")]
    for (capture, stage, state), tasks in sorted(groups.items()):
        size = _megabytes(sum(task.size_bytes for task in tasks))
        last = max(task.last_used_s for task in tasks)
        day = datetime.fromtimestamp(last).astimezone().strftime("%Y-%m-%d %H:%M")
        rows.append((capture, stage, str(len(tasks)), size, day, state))
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    to_the_right = (2, 3)  # numbers
    return "\n".join(
        "  ".join(
            text.rjust(width) if column in to_the_right else text.ljust(width)
            for column, (text, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    )


def _size(stored: Iterable["StoredTask"]) -> str:
    tasks = list(stored)
    return f"{len(tasks)} {'task' if len(tasks) == 1 else 'tasks'}, {_megabytes(sum(t.size_bytes for t in tasks))}"


def _megabytes(size_bytes: int) -> str:
    return f"{size_bytes / 1e6:,.1f} MB"
