"""Build many plants from a list or a folder of captures, with an index page.

LIST is one of these:

    a folder       each folder of photographs, capture and point cloud in it is a plant, and each photograph that has
                   strokes beside it, as NAME.strokes.json
    a text file    one capture on each line; a name and a plan (TOML) may follow after tabs
    a CSV file     with a column capture; columns name and plan are optional

Paths in a list are relative to the list. All plants share the work folder and the processes. If one plant fails, the
others are still built. A second run builds only what is new or changed. DIR/index.html shows all plants, also while
they are built.

The exit code is 0 if all plants are built, 2 if some cannot be built, and 3 if validation finds errors in some.
"""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from usdfoliage.cli.json_output import add_json
from usdfoliage.cli.options.access import given
from usdfoliage.cli.options.build import add_ending, add_plan, add_where, add_work
from usdfoliage.cli.remarks import render_for
from usdfoliage.files.printable import printable
from usdfoliage.files.write_gate import Access

if TYPE_CHECKING:
    from usdfoliage.jobs.plant.call import BuildRequest
    from usdfoliage.jobs.plant.finish import BuiltPlant
    from usdfoliage.jobs.plant.library import LibraryList
    from usdfoliage.jobs.plant.pages.library_page import LibraryPlant

_ROW = "{:<24}  {:<8}  {:>7}  {:>7}  {:>9}  {}"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    files = parser.add_argument_group("input and output")
    files.add_argument(
        "list", metavar="LIST", type=Path, help="The input is a list of captures, or a folder of captures."
    )
    files.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        required=True,
        help="The assets are written to this folder, each plant to a folder of its own.",
    )
    add_work(files)
    add_plan(parser.add_argument_group("settings of all plants"))
    run_options = parser.add_argument_group("this run")
    add_where(run_options)
    add_ending(run_options)
    add_json(run_options)


def declare(options: argparse.Namespace) -> Access:
    from usdfoliage.cli.options.access import parts_of_build
    from usdfoliage.files.write_gate import join_access
    from usdfoliage.jobs.plant.library import read_library
    from usdfoliage.jobs.plant.work_folder import find_work_folder

    options.listed = read_library(options.list)  # what is declared is what is built, should the list change meanwhile
    work = find_work_folder(options.work, options.output / "plant")
    outputs = [options.output / entry.name for entry in options.listed.entries]
    plants = [
        Access(reads=(*parts_of_build(entry.capture, output), *given(entry.plan)), replaces=(output,), fills=(work,))
        for entry, output in zip(options.listed.entries, outputs, strict=True)
    ]
    own = given(None if options.list.is_dir() else options.list, options.plan, options.profile)
    return join_access([Access(reads=own), *plants])


def run(options: argparse.Namespace) -> int:
    from usdfoliage.cli.interrupts import handle_interrupts
    from usdfoliage.cli.json_output import format_made
    from usdfoliage.cli.options.build import read_where
    from usdfoliage.cli.plant_progress import PlantBar
    from usdfoliage.cli.plant_results import EXIT_CODES, list_plant
    from usdfoliage.jobs.plant.library import LibraryIndex, describe_built
    from usdfoliage.jobs.plant.run import build_plants

    handle_interrupts()
    render = render_for("batch")
    where = read_where(options)
    listed = options.listed
    requests, failed = _read_requests(options, listed)
    if options.dry_run:
        return _print_plans(requests, failed)
    folder = options.output.absolute()
    index = LibraryIndex(folder=folder, plants=len(listed.entries), skipped=listed.skipped)
    for plant in failed:
        index.add(plant)
    listed_plants = [_list_unbuilt(plant) for plant in (*failed, *listed.skipped)]
    codes = {EXIT_CODES["failed"]} if failed else set()
    if not options.json:
        print(_ROW.format("plant", "", "seconds", "leaves", "size", ""))
        for plant in (*failed, *listed.skipped):
            print(_ROW.format(plant.name, plant.state, "", "", "", printable(plant.sentence(render))))
    counts: dict[str, int] = {"failed": len(failed)} if failed else {}
    try:
        with PlantBar() as bar:
            for _, made in build_plants(requests, where, bar.show):
                plant = describe_built(made, folder)
                if not options.json:
                    bar.write(_describe(made, plant))
                capture = str(made.request.capture)
                listed_plants.append({"name": made.request.name, "capture": capture, **list_plant(made, "batch")})
                index.add(plant)
                codes.add(EXIT_CODES[made.verdict])
                counts[made.verdict] = counts.get(made.verdict, 0) + 1
                if made.is_fault and options.debug:
                    print(made.error, file=sys.stderr)
    except KeyboardInterrupt:
        index.write()
        print("error: interrupted; the same command goes on from here", file=sys.stderr)
        return 130
    page = index.write()
    exit_code = next((code for code in (1, 2, 3) if code in codes), 0)
    if options.json:
        listed_plants.sort(key=lambda plant: str(plant["name"]))
        print(format_made(asset=None, report=page, facts=(), remarks=(), plants=listed_plants))
        return exit_code
    text = ", ".join(f"{count} {verdict}" for verdict, count in sorted(counts.items()))
    print(f"{len(listed.entries)} plants: {text}{f', {len(listed.skipped)} skipped' if listed.skipped else ''}")
    print(f"index: {page}")
    return exit_code


def _list_unbuilt(plant: "LibraryPlant") -> dict[str, object]:
    """A plant that was not tried, with the keys of one that was."""
    from usdfoliage.cli.json_output import list_made

    return {
        "name": plant.name,
        "capture": plant.capture,
        **list_made(
            asset=None,
            report=None,
            facts=(),
            remarks=(),
            verdict=plant.state,
            error=plant.sentence(render_for("batch")),
            errors=0,
            withheld=None,
            seconds={},
        ),
    }


def _read_requests(
    options: argparse.Namespace, listed: "LibraryList"
) -> "tuple[list[BuildRequest], list[LibraryPlant]]":
    """What can be asked for; and what not, since its plan cannot be read."""
    from dataclasses import replace

    from usdfoliage.cli.options.build import read_request, read_settings
    from usdfoliage.errors import FoliageError
    from usdfoliage.jobs.plant.library import describe_failed, explain_entry
    from usdfoliage.jobs.plant.settings import with_seed
    from usdfoliage.jobs.work.settings_file import read_settings_file

    settings = read_settings(options)  # once: a fault in it is one of all plants
    first = read_request(options, listed.entries[0].capture, options.output / "plant", None)
    here = Path.cwd()  # once for all
    requests, failed, folder = [], [], here / options.output
    for entry in listed.entries:
        try:
            own = settings
            if entry.plan is not None:
                own = read_settings_file(entry.plan, settings)
                own = with_seed(own, own.seed)
            if entry.tree is not None:
                own = replace(own, sketch=replace(own.sketch, tree=entry.tree))
        except FoliageError as error:
            failed.append(describe_failed(entry.name, entry.capture.name, explain_entry(entry, error)))
            continue
        output = folder / entry.name
        requests.append(replace(first, capture=here / entry.capture, output=output, name=entry.name, settings=own))
    return requests, failed


def _describe(made: "BuiltPlant", plant: "LibraryPlant") -> str:
    seconds = sum((made.seconds or {}).values())
    size = "" if plant.size_bytes is None else f"{plant.size_bytes / 1e6:.1f} MB"
    leaves = "" if plant.leaves is None else f"{plant.leaves:,}"
    text = plant.sentence(render_for("batch"))
    if made.verdict == "built" and not made.seconds:
        text = f"nothing to do{f'; {text}' if text else ''}"
    return _ROW.format(made.request.name, made.verdict, f"{seconds:.1f}", leaves, size, text).rstrip()


def _print_plans(requests: "list[BuildRequest]", failed: "list[LibraryPlant]") -> int:
    from usdfoliage.errors import FoliageError
    from usdfoliage.jobs.plant.plan_text import in_words
    from usdfoliage.jobs.plant.run import plan_plant
    from usdfoliage.jobs.plant.tasks import find_wanted
    from usdfoliage.remarks import explain_error

    row = "{:<24}  {:>11}  {:>5}  {:>5}  {:>7}  {}"
    print(row.format("plant", "photographs", "tasks", "to do", "seconds", ""))
    render = render_for("batch")
    total_s, bad = 0.0, len(failed)
    for plant in failed:
        print(row.format(plant.name, "", "", "", "", printable(plant.sentence(render))))
    for request in requests:
        try:
            inputs, plan = plan_plant(request, "names")
            wanted, _ = find_wanted(plan, request.store, thorough=False)
        except FoliageError as error:
            bad += 1
            print(row.format(request.name, "", "", "", "", f"error: {printable(explain_error(error, render))}"))
            continue
        seconds = sum(task.estimate_s for task in wanted.values())
        total_s += seconds
        counts = (inputs.photograph_count, len(plan.tasks), len(wanted))
        print(row.format(request.name, *counts, f"{seconds:.0f}", "").rstrip())
    print(f"{len(requests) + len(failed)} plants, {bad} of them cannot be built; {in_words(total_s)} on two cores")
    return 2 if bad else 0
