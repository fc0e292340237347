"""The task that makes a cloud of the depth of all photographs."""

import shutil
from dataclasses import replace

from usdfoliage.capture.poses.world_frame import WorldSettings
from usdfoliage.errors import CaptureError
from usdfoliage.jobs.capture.results import CLOUD, REPORT
from usdfoliage.jobs.capture.run import CaptureRequest, make_capture
from usdfoliage.jobs.plant.call import StageCall
from usdfoliage.jobs.plant.stages.capture import capture_folder, capture_name, store_of_views
from usdfoliage.jobs.plant.store import ResultFile
from usdfoliage.jobs.plant.summary import StagePicture, StageSummary, write_summary
from usdfoliage.jobs.plant.tasks import POSES
from usdfoliage.jobs.report.table import Row
from usdfoliage.jobs.work.results import WORK


def make_cloud(call: StageCall) -> tuple[ResultFile, ...]:
    """The cloud of all depth, in a capture with maps, cameras and a layer for USD."""
    capture = call.out / "capture" / capture_name(call)
    made = make_capture(
        CaptureRequest(
            source=capture_folder(call, POSES),
            output=capture,
            settings=replace(call.settings.capture, poses="known", world=WorldSettings()),
            threads=call.threads,
            store=store_of_views(call),
            times=False,
        ),
        call.progress,
    )
    shutil.rmtree(capture / WORK.split("/", maxsplit=1)[0])  # only what is of this very run
    rows = [
        Row(name="with depth", value=f"{made.views:,}", remark="photographs"),
        Row(name="coverage", value=f"{made.coverage:.0%}", remark="of the median photograph has depth"),
        Row(name="points", value=f"{made.points:,}"),
    ]
    report = capture / REPORT
    pictures = [
        StagePicture(file=(report / picture.file).relative_to(call.out).as_posix(), caption=picture.caption)
        for picture in made.pictures
    ]
    remarks = [each for each in made.remarks if each.code != "tasks-done-before"]  # by other tasks of this build
    detail = (report / "index.html").relative_to(call.out).as_posix()
    write_summary(call.out, StageSummary(rows=rows, remarks=remarks, pictures=pictures, detail=detail))
    if not (capture / CLOUD).is_file():
        raise CaptureError(f"{capture} has no cloud")
    return ()
