"""A summary is a file beside a result, and holds remarks as values."""

from pathlib import Path

from usdfoliage.jobs.plant.summary import StageSummary, read_summary, rename_paths, write_summary
from usdfoliage.remarks import Argument, Setting, remark

HIGH = remark(
    "plant-height-improbable",
    "the plant of /captures/oak.ply is 900 m high",
    subject="/captures/oak.ply",
    remedy=("give ", Setting(name="branches.unit", value='"mm"')),
)


def test_remarks_survive_the_file(tmp_path: Path) -> None:
    write_summary(tmp_path, StageSummary(remarks=[HIGH], remedy=("use ", Argument(name="force"))))
    summary = read_summary(tmp_path)
    assert summary.remarks == (HIGH,)
    assert summary.remedy == ("use ", Argument(name="force"))
    assert summary.warning_texts() == ['the plant of /captures/oak.ply is 900 m high: give branches.unit = "mm"']
    assert summary.info_texts() == []


def test_files_are_renamed_in_remarks_too(tmp_path: Path) -> None:
    write_summary(
        tmp_path, StageSummary(remarks=[HIGH], failure="/captures/oak.ply is broken", remedy=("see /captures/oak.ply",))
    )
    rename_paths(tmp_path, lambda text: text.replace("/captures/", ""))
    summary = read_summary(tmp_path)
    assert summary.remarks[0].subject == "oak.ply"
    assert summary.remarks[0].text == "the plant of oak.ply is 900 m high"
    assert summary.failure == "oak.ply is broken"
    assert summary.remedy == ("see oak.ply",)
