"""The task that measures the finished asset by photographs that were withheld."""

from usdfoliage.asset.packages.contents import interface_of
from usdfoliage.capture.folder.hold_back import choose_withheld
from usdfoliage.capture.folder.read import read_capture
from usdfoliage.jobs.plant.call import StageCall
from usdfoliage.jobs.plant.stages.assemble import ASSET_FOLDER
from usdfoliage.jobs.plant.stages.capture import withheld_folder
from usdfoliage.jobs.plant.store import ResultFile
from usdfoliage.jobs.plant.summary import StagePicture, StageSummary, write_summary
from usdfoliage.jobs.plant.tasks import ASSET
from usdfoliage.jobs.withheld.measure import measure_by_withheld


def measure_plant(call: StageCall) -> tuple[ResultFile, ...]:
    """The asset over every photograph that was withheld, in pictures and figures."""
    interface, _ = interface_of(call.result_of(ASSET) / ASSET_FOLDER)
    capture = read_capture(withheld_folder(call))
    posed = {view.name for view in capture.views}
    every = call.settings.plant.hold_back
    lost = [name for name in choose_withheld(list(call.inputs.photographs), every) if name not in posed]
    made = measure_by_withheld(
        interface, capture, call.out, every, lost=lost, threads=call.threads, progress=call.report_parts
    )
    pictures = [StagePicture(file=picture.file, caption=picture.caption) for picture in made.pictures()]
    write_summary(call.out, StageSummary(rows=made.rows(), remarks=made.remarks, pictures=pictures))
    return ()
