"""Where stems cannot be looked for in photographs, branches are those of the cloud, and a remark gives the reason."""

from types import SimpleNamespace

import pytest
from usdfoliage.errors import CaptureError, FitError, WriteError
from usdfoliage.jobs.branches.tracing import NoStemsError
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.plant.stages import parts, stems
from usdfoliage.jobs.plant.summary import read_summary


def refuse_with(error: Exception):
    def refuse(*arguments, **options):
        raise error

    return refuse


@pytest.fixture
def call(tmp_path, monkeypatch):
    """A task whose cloud is traced by a stand-in, which looks for stems in photographs and ends as it is given."""
    out = tmp_path / "result"
    out.mkdir()
    monkeypatch.setattr(parts, "plant_capture", lambda call: tmp_path)
    return SimpleNamespace(
        request=SimpleNamespace(name="herb"),
        settings=BuildSettings(),
        out=out,
        progress=None,
        has=lambda name: name == parts.CLOUD,
    )


def trace_by(monkeypatch, error: Exception):
    """What follows in the trace of the cloud, once the photographs have no stems."""

    def find_branches(request, fitted, seconds, progress, find_stems):
        assert find_stems(0.001) is None
        raise error

    monkeypatch.setattr(parts, "find_branches", find_branches)


@pytest.mark.parametrize(
    ("error", "code"), [(NoStemsError("a hedge"), "branches-left-out"), (FitError("a line"), "part-failed")]
)
def test_the_cloud_is_traced_on_where_photographs_cannot_be_searched(call, monkeypatch, error, code):
    failed = CaptureError("000.jpg cannot be read", "copy it again")
    monkeypatch.setattr(stems, "find_photographed_stems", refuse_with(failed))
    trace_by(monkeypatch, error)
    assert parts.trace_branches(call) == ()
    remarks = read_summary(call.out).remarks
    assert [each.code for each in remarks] == [code, "stems-not-looked-for"]
    assert remarks[1].text == "stems were not looked for in the photographs: 000.jpg cannot be read"
    assert "copy it again" in str(remarks[1].remedy)


def test_what_fails_here_and_now_is_no_result(call, monkeypatch):
    monkeypatch.setattr(stems, "find_photographed_stems", refuse_with(WriteError("the disk is full")))
    trace_by(monkeypatch, FitError("a line"))
    with pytest.raises(WriteError, match="disk is full"):
        parts.trace_branches(call)
