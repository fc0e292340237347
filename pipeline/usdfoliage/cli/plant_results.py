"""What is printed of a plant that was built, and of an asset that a command has put in its place."""

import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from usdfoliage.cli.json_output import format_json, format_made, list_made
from usdfoliage.cli.remarks import print_remarks, render_for
from usdfoliage.files.printable import printable
from usdfoliage.remarks import warnings_of

if TYPE_CHECKING:
    from usdfoliage.jobs.plant.finish import BuiltPlant
    from usdfoliage.jobs.report.published import PublishedAsset
    from usdfoliage.jobs.report.table import Row

EXIT_CODES: Mapping[str, int] = {"built": 0, "failed": 2, "invalid": 3, "fault": 1}


def print_published(made: "PublishedAsset", command: str, *, as_json: bool) -> None:
    """Where an asset is, and what the user should know, with settings as command has them; or all of it as JSON."""
    if as_json:
        print(format_made(asset=made.asset, report=made.report, facts=made.rows, remarks=made.remarks))
        return
    print_remarks(made.remarks, command)
    print_rows(made.rows)
    print(f"asset: {made.asset}")
    if made.preview:
        print(f"preview: {made.preview}")
    print(f"report: {made.report}")


def print_leaves(made: "Sequence[PublishedAsset]", command: str, *, as_json: bool) -> None:
    """The same of several assets of one run; as JSON in one object whose assets are a list."""
    if as_json:
        leaves = [
            list_made(asset=each.asset, report=each.report, facts=each.rows, remarks=each.remarks) for each in made
        ]
        print(format_made(asset=None, report=None, facts=(), remarks=(), leaves=leaves))
        return
    for each in made:
        print_published(each, command, as_json=False)


def print_rows(rows: "Iterable[Row]") -> None:
    """Figures, a line each."""
    for row in rows:
        print(f"{row.name}: {row.value}{f' ({row.remark})' if row.remark else ''}")


def print_plant(made: "BuiltPlant", command: str, *, debug: bool = False) -> None:
    """Where the asset is, and what the user should know; on stderr why there is none. Settings as command has them."""
    render = render_for(command)
    name = made.request.name
    if made.verdict in ("failed", "fault"):
        if made.is_fault:
            print(
                report_fault(made.error, f"{made.failed} of {name}" if made.failed else name, debug=debug),
                file=sys.stderr,
            )
        else:
            print(f"error: {printable(made.explain(render))}", file=sys.stderr)
        return
    for warning in warnings_of(made.remarks):
        print(f"warning: {printable(warning.sentence(render))}")
    print_rows(made.facts)
    print_withheld(made.withheld)
    ran = len(made.seconds or {})
    print(f"tasks: {made.tasks}, {made.cached} of them done by an earlier run, {ran} done now")
    if made.seconds:
        print(f"seconds: {', '.join(f'{stage} {seconds:.1f}' for stage, seconds in made.seconds_by_stage().items())}")
    if made.asset is None:
        print(f"result: {made.result}")
        if made.errors:
            text = f"{made.errors} error{'s' if made.errors != 1 else ''}"
            print(
                f"error: validation finds {text}, and {made.request.output} was not written; see "
                f"{made.result}/report/index.html, or put it there nevertheless with --keep-invalid",
                file=sys.stderr,
            )
        return
    print(f"asset: {made.asset}")
    thumbnail = made.request.output / "thumbnails" / f"{name}.png"
    if thumbnail.is_file():  # without Storm there is none
        print(f"preview: {thumbnail}")
    print(f"report: {made.request.output / 'report' / 'index.html'}")


def print_withheld(figures: Mapping[str, object] | None) -> None:
    """The asset against photographs that were withheld, a line for their mean and one for each; nothing without."""
    if figures is None:
        return
    from usdfoliage.jobs.withheld.measure import list_figures

    print_rows(list_figures(figures))


def format_plant(made: "BuiltPlant", command: str) -> str:
    """What became of a plant, as JSON, with settings as command has them."""
    return format_json(list_plant(made, command))


def list_plant(made: "BuiltPlant", command: str) -> dict[str, object]:
    """What became of a plant: the keys and values of its JSON object, with settings as command has them."""
    page = None if made.result is None else made.result / "report" / "index.html"
    if made.asset is not None:
        page = made.request.output / "report" / "index.html"
    return list_made(
        asset=made.asset,
        report=page,
        facts=made.facts,
        remarks=made.remarks,
        verdict=made.verdict,
        error=made.explain(render_for(command)),
        errors=made.errors,
        withheld=made.withheld,
        seconds=dict(made.seconds or {}),
    )


def report_fault(trace: str, where: str, *, debug: bool) -> str:
    """What is printed of a fault of ours."""
    text = trace if debug else printable(trace.strip().splitlines()[-1])
    return f"error: internal fault in {printable(where)}: {text}; run again with --debug and report it"
