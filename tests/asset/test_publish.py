"""An asset folder is replaced whole or not at all: after errors, full disks and kills at any moment."""

import errno
import json
import os
import signal
import subprocess
import sys
import textwrap
from dataclasses import replace
from pathlib import Path

import pytest
from pxr import Sdf, Vt
from usdfoliage.asset import publish
from usdfoliage.asset.asset_record import FILES_LIST, AssetOrigin, foreign_files, is_asset_folder, read_origin
from usdfoliage.asset.look_layer import CUSTOM_DATA_KEY, LOOK_OF
from usdfoliage.asset.publish import plan_folder, publish_folder
from usdfoliage.errors import AssetError


def write_asset(folder, text):
    """The smallest asset of ours, and a file that distinguishes two of them."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.customLayerData = {CUSTOM_DATA_KEY: {"generator": "test"}}
    assert layer.Export(str(folder / "oak.usda"))
    (folder / "maps").mkdir()
    (folder / "maps" / "which.txt").write_text(text)


def publish_asset(out, text, then=None):
    """One run: write an asset, and then do what a test wants before the run ends."""
    with publish_folder(out) as folder:
        write_asset(folder, text)
        if then is not None:
            then()


def which(out):
    return (out / "maps" / "which.txt").read_text()


@pytest.fixture
def out(tmp_path):
    """An asset of an earlier run."""
    path = tmp_path / "assets" / "oak"
    with publish_folder(path) as folder:
        write_asset(folder, "old")
    return path


def left_over(out):
    return sorted(path.name for path in out.parent.iterdir() if path != out)


@pytest.fixture(params=["exchange", "two renames"])
def any_file_system(request, monkeypatch):
    if request.param == "two renames":
        monkeypatch.setattr(publish, "exchange", lambda first, second: False)


@pytest.mark.usefixtures("any_file_system")
def test_new_replaces_old(out):
    with publish_folder(out) as folder:
        write_asset(folder, "old")
        (folder / "maps" / "only_in_old.txt").touch()
    with publish_folder(out) as folder:
        assert folder.parent == out.parent
        assert not list(folder.iterdir())
        write_asset(folder, "new")
        assert which(out) == "old"
    assert which(out) == "new"
    assert not (out / "maps" / "only_in_old.txt").exists()
    assert left_over(out) == []


def test_folder_and_its_parents_are_made(tmp_path):
    out = tmp_path / "a b" / "c" / "eiche ä"
    with publish_folder(out) as folder:
        write_asset(folder, "new")
    assert which(out) == "new"
    assert left_over(out) == []


def test_empty_folder_is_replaced(tmp_path):
    (tmp_path / "oak").mkdir(mode=0o750)
    with publish_folder(tmp_path / "oak") as folder:
        write_asset(folder, "new")
    assert which(tmp_path / "oak") == "new"
    assert (tmp_path / "oak").stat().st_mode & 0o777 == 0o750


@pytest.mark.usefixtures("any_file_system")
@pytest.mark.parametrize("error", [RuntimeError("fault"), KeyboardInterrupt(), AssetError("refused")])
def test_error_in_the_body_changes_nothing(out, error):

    def fail():
        raise error

    with pytest.raises(type(error)):
        publish_asset(out, "new", fail)
    assert which(out) == "old"
    assert left_over(out) == []


def test_error_leaves_no_parents_behind(tmp_path):
    with pytest.raises(RuntimeError), publish_folder(tmp_path / "a" / "b" / "oak"):
        raise RuntimeError
    assert not list(tmp_path.iterdir())


def test_a_full_disk_is_reported_and_changes_nothing(out):
    message = r"oak was not written: No space left on device.*MB are free.*unchanged"
    with pytest.raises(AssetError, match=message), publish_folder(out):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "maps/x.exr")
    assert which(out) == "old"
    assert left_over(out) == []


def test_failing_second_rename_puts_the_old_folder_back(out, monkeypatch):
    monkeypatch.setattr(publish, "exchange", lambda first, second: False)
    rename = Path.rename

    def fail_for_new(self, target):
        if self.name.endswith("usdfoliage-new"):
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", fail_for_new)
    with pytest.raises(AssetError, match="Input/output error"):
        publish_asset(out, "new")
    assert which(out) == "old"
    assert left_over(out) == []


def test_foreign_folder_is_refused_without_force(tmp_path):
    out = tmp_path / "thesis"
    out.mkdir()
    (out / "chapter1.txt").write_text("precious")
    with pytest.raises(AssetError, match=r"thesis.*argument force"), publish_folder(out):
        pytest.fail("the body must not run")
    assert (out / "chapter1.txt").read_text() == "precious"
    assert left_over(out) == []
    with pytest.raises(AssetError, match=r"never replaced"), publish_folder(out, force=True):
        pytest.fail("the body must not run")
    assert (out / "chapter1.txt").read_text() == "precious"
    assert left_over(out) == []


def as_earlier_versions_wrote(out, files):
    """Put the list of files into the interface layer itself, where it was before it had a file of its own."""
    (out / FILES_LIST).unlink()
    (out / "report").rmdir()
    layer = Sdf.Layer.FindOrOpen(str(out / "oak.usda"))
    layer.customLayerData = {CUSTOM_DATA_KEY: {"generator": "test", "files": Vt.StringArray(files)}}
    layer.Save()


def test_the_interface_layer_names_the_list_of_files(out):
    layer = Sdf.Layer.FindOrOpen(str(out / "oak.usda"))
    assert layer.customLayerData[CUSTOM_DATA_KEY] == {"generator": "test", "files": "report/files.json"}
    listed = json.loads((out / FILES_LIST).read_text())
    assert listed == {"files": ["maps/which.txt", "oak.usda", "report/files.json"]}


@pytest.mark.parametrize("earlier", [False, True])
def test_files_of_others_in_an_asset_are_not_lost(out, earlier):
    if earlier:
        as_earlier_versions_wrote(out, ["maps/which.txt", "oak.usda"])
    assert foreign_files(out) == []
    publish_asset(out, "again")
    if earlier:
        as_earlier_versions_wrote(out, ["maps/which.txt", "oak.usda"])
    (out / "maps" / "mine.txt").write_text("precious")
    assert foreign_files(out) == ["maps/mine.txt"]
    with pytest.raises(AssetError, match=r"not the asset's: maps/mine.txt; .*argument force"):
        publish_asset(out, "new")
    assert (out / "maps" / "mine.txt").read_text() == "precious"
    assert which(out) == "again"


@pytest.mark.parametrize("damage", ["", "{", "[1]", '{"files": 3}', '{"files": [3]}', None])
def test_an_asset_that_lost_the_list_of_its_files_is_replaced_with_force_alone(out, damage):
    if damage is None:
        (out / FILES_LIST).unlink()
    else:
        (out / FILES_LIST).write_text(damage)
    with pytest.raises(AssetError, match=r"report/files.json, .*cannot be read.*argument force"):
        publish_asset(out, "new")
    assert which(out) == "old"
    with publish_folder(out, force=True) as folder:
        write_asset(folder, "new")
    assert which(out) == "new"
    assert foreign_files(out) == []
    assert left_over(out) == ["oak.old-1"]  # nobody knows what in it is the asset's own
    assert which(out.with_name("oak.old-1")) == "old"


@pytest.mark.parametrize("extra", ["shot.usda", "OTHER.USDC"])
def test_second_usd_file_makes_a_folder_foreign(out, extra):
    (out / extra).write_text("#usda 1.0\n")
    assert not is_asset_folder(out)
    with pytest.raises(AssetError, match="argument force"), publish_folder(out):
        pytest.fail("the body must not run")


@pytest.mark.parametrize("text", ["#usda 1.0\n", "no usd at all", ""])
def test_usd_file_of_somebody_else_makes_a_folder_foreign(tmp_path, text):
    (tmp_path / "oak.usda").write_text(text)
    assert not is_asset_folder(tmp_path)


def test_a_folder_with_a_look_is_no_asset(tmp_path):
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.customLayerData = {CUSTOM_DATA_KEY: {LOOK_OF: "../oak/oak.usda"}}
    assert layer.Export(str(tmp_path / "wide.usda"))
    (tmp_path / "thesis.txt").write_text("precious")
    assert not is_asset_folder(tmp_path)
    with pytest.raises(AssetError, match="other things"), publish_folder(tmp_path):
        pytest.fail("the body must not run")
    assert (tmp_path / "thesis.txt").read_text() == "precious"


def test_force_spares_the_home_and_the_current_folder(tmp_path, monkeypatch):
    (tmp_path / "here" / "below").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "here" / "below")
    with pytest.raises(AssetError, match="current folder"), publish_folder(tmp_path / "here", force=True):
        pytest.fail("the body must not run")
    monkeypatch.setenv("HOME", str(tmp_path / "here"))
    monkeypatch.chdir("/")
    with pytest.raises(AssetError, match="home"), publish_folder(tmp_path, force=True):
        pytest.fail("the body must not run")


def test_file_is_refused(tmp_path):
    (tmp_path / "oak").write_text("a file")
    for out in (tmp_path / "oak", tmp_path / "oak" / "below"):
        for force in (False, True):
            with pytest.raises(AssetError, match="oak"), publish_folder(out, force=force):
                pytest.fail("the body must not run")
    assert (tmp_path / "oak").read_text() == "a file"


def test_symbolic_links(tmp_path, out):
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    with pytest.raises(AssetError, match="loop"), publish_folder(tmp_path / "loop"):
        pytest.fail("the body must not run")
    (tmp_path / "dangling").symlink_to(tmp_path / "missing")
    with pytest.raises(AssetError, match="missing"), publish_folder(tmp_path / "dangling"):
        pytest.fail("the body must not run")
    (tmp_path / "link").symlink_to(out)
    with publish_folder(tmp_path / "link") as folder:
        write_asset(folder, "new")
    assert (tmp_path / "link").is_symlink()
    assert which(out) == "new"


def test_an_unwritable_parent_is_reported():
    if not Path("/proc/self").exists():
        pytest.skip("/proc, where nobody can write, is absent")
    with pytest.raises(AssetError, match="/proc/oak"), publish_folder(Path("/proc/oak")):
        pytest.fail("the body must not run")
    with pytest.raises(AssetError, match="root of the file system"), publish_folder(Path("/")):
        pytest.fail("the body must not run")


def test_what_appears_meanwhile_is_not_lost(tmp_path):
    out = tmp_path / "oak"

    def appear():
        out.mkdir()
        (out / "other.txt").write_text("somebody else's")

    with pytest.raises(AssetError, match="argument force"):
        publish_asset(out, "new", appear)
    assert (out / "other.txt").read_text() == "somebody else's"
    assert left_over(out) == []


def test_two_runs_at_once_both_end_well(out):
    with publish_folder(out) as first:
        write_asset(first, "first")
        with publish_folder(out) as second:  # it must not take the first for a dead one
            write_asset(second, "second")
        assert which(out) == "second"
        assert which(first) == "first"
    assert which(out) == "first"
    assert left_over(out) == []


KILLED = """
import os, signal, sys
from pathlib import Path
from usdfoliage.asset import publish
from tests.asset.test_publish import write_asset

def die(*_):
    os.kill(os.getpid(), signal.SIGKILL)

moment = {moment!r}
rename, take_place, remove, flush = Path.rename, publish._take_place, publish._remove, publish._flush
if moment.startswith("two renames"):
    publish.exchange = lambda first, second: False
if moment == "flush":
    publish._flush = die
if moment == "before the exchange":
    publish._take_place = die
if moment == "after the exchange":
    publish._remove = die
if moment == "two renames, between":
    Path.rename = lambda self, target: die() if self.name.endswith("usdfoliage-new") else rename(self, target)
if moment == "two renames, after":
    publish._remove = die
with publish.publish_folder(Path({out!r})) as folder:
    if moment == "empty":
        die()
    write_asset(folder, "new")
    if moment == "written":
        die()
"""


@pytest.mark.parametrize(
    ("moment", "expected"),
    [
        ("empty", "old"),
        ("written", "old"),
        ("flush", "old"),
        ("before the exchange", "old"),
        ("after the exchange", "new"),
        ("two renames, between", None),
        ("two renames, after", "new"),
    ],
)
def test_kill_at_any_moment_leaves_one_whole_asset(out, moment, expected):
    program = textwrap.dedent(KILLED).format(moment=moment, out=str(out))
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert left_over(out) != []
    if expected is not None:
        assert which(out) == expected
        assert is_asset_folder(out)
    # The next run begins from a whole asset, even where the system cannot exchange folders, and cleans up.
    with pytest.raises(RuntimeError), publish_folder(out):
        raise RuntimeError
    assert which(out) == (expected or "old")
    assert is_asset_folder(out)
    assert left_over(out) == []


def refused_by(check, out, force):
    with pytest.raises(AssetError) as refused:
        check(out, force)
    return str(refused.value)


def really_publish(out, force):
    with publish_folder(out, force=force) as folder:
        write_asset(folder, "new")


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize("place", ["file", "below a file", "dangling", "root", "strange", "foreign", "here"])
def test_a_plan_refuses_what_a_run_refuses(out, place, force, tmp_path, monkeypatch):
    strange = tmp_path / "strange"
    strange.mkdir()
    (strange / "notes.txt").write_text("mine")
    (tmp_path / "dangling").symlink_to(tmp_path / "nowhere")
    named = {
        "file": strange / "notes.txt",
        "below a file": strange / "notes.txt" / "oak",
        "dangling": tmp_path / "dangling",
        "root": Path("/"),
        "strange": strange,
        "foreign": out,
        "here": strange,
    }[place]
    if place == "here":
        monkeypatch.chdir(strange)
    if place == "foreign":
        (out / "mine.txt").write_text("mine")
    before = sorted(tmp_path.rglob("*"))
    if force and place == "foreign":
        assert plan_folder(named, "oak.usda", force) == f"would replace: {named / 'oak.usda'}"
    else:
        planned = refused_by(lambda path, force: plan_folder(path, "oak.usda", force), named, force)
        assert planned == refused_by(really_publish, named, force)
    assert sorted(tmp_path.rglob("*")) == before


def test_a_plan_reports_whether_something_is_replaced(out, tmp_path):
    assert plan_folder(out, "oak.usda") == f"would replace: {out / 'oak.usda'}"
    assert plan_folder(tmp_path / "a" / "b", "b.usda") == f"would write: {tmp_path / 'a' / 'b' / 'b.usda'}"
    assert not (tmp_path / "a").exists()


def test_where_a_file_system_is_mounted_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(Path, "is_mount", lambda path: path == tmp_path)
    for check in (really_publish, lambda path, force: plan_folder(path, "oak.usda", force)):
        assert "name a folder in it" in refused_by(check, tmp_path, True)


def test_a_plan_refuses_a_folder_that_cannot_be_written_into(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # root may write everywhere
    with pytest.raises(AssetError, match="cannot be written: Permission denied; nothing was written"):
        plan_folder(tmp_path / "a" / "oak", "oak.usda")


OAK = AssetOrigin(name="oak", command="leaves", source="capture")


def publish_as(out, origin, text="new", **how):
    with publish_folder(out, origin=origin, **how) as folder:
        write_asset(folder, text)


@pytest.mark.parametrize("changed", [{"name": "ash"}, {"command": "bake"}, {"source": "other"}])
def test_only_an_asset_of_the_same_name_and_origin_is_replaced_without_force(tmp_path, changed):
    out = tmp_path / "oak"
    publish_as(out, OAK, "old")
    publish_as(out, OAK, "again")
    other = replace(OAK, **changed)
    with pytest.raises(AssetError, match="argument force"):
        publish_as(out, other)
    with pytest.raises(AssetError, match="argument force"):
        plan_folder(out, "oak.usda", origin=other)
    assert which(out) == "again"
    publish_as(out, other, force=True)
    assert which(out) == "new"
    assert read_origin(out) == replace(other, name="oak")  # the name of its interface layer


def forget_origin(out, capture):
    """As earlier versions wrote it, which recorded the input alone."""
    layer = Sdf.Layer.FindOrOpen(str(out / "oak.usda"))
    record = layer.customLayerData[CUSTOM_DATA_KEY]
    del record["origin"]
    layer.customLayerData = {CUSTOM_DATA_KEY: {**record, "capture": capture}}
    layer.Save()


@pytest.mark.parametrize("capture", ["capture", "D:\\plants\\capture", "/plants/capture"])
def test_of_an_asset_of_an_earlier_version_name_and_input_are_compared(tmp_path, capture):
    out = tmp_path / "oak"
    publish_as(out, OAK)
    forget_origin(out, capture)
    for changed in ({"name": "ash"}, {"source": "other"}):
        with pytest.raises(AssetError, match="argument force"):
            publish_as(out, replace(OAK, **changed))
    publish_as(out, OAK)
    assert read_origin(out) == OAK


def test_an_asset_of_an_earlier_version_without_an_input_is_replaced_with_force_alone(tmp_path):
    out = tmp_path / "oak"
    publish_as(out, OAK, "old")
    forget_origin(out, "")
    scattered = AssetOrigin(name="oak", command="scatter")
    with pytest.raises(AssetError, match="made by an earlier version"):
        publish_as(out, scattered)
    assert which(out) == "old"
    publish_as(out, read_origin(out), "baked in its folder")
    publish_as(out, scattered, force=True)
    assert which(out) == "new"


def test_the_origin_is_known_where_the_list_of_files_is_lost(tmp_path):
    out = tmp_path / "oak"
    publish_as(out, OAK)
    (out / FILES_LIST).unlink()
    assert read_origin(out) == OAK


def test_an_asset_without_a_list_is_replaced_with_force_alone_and_kept_aside(tmp_path):
    out = tmp_path / "oak"
    out.mkdir()
    write_asset(out, "old")
    with pytest.raises(AssetError, match="no list of the asset's own files"):
        publish_asset(out, "new")
    assert which(out) == "old"
    publish_as(out, OAK, force=True)
    assert which(out) == "new"
    assert left_over(out) == ["oak.old-1"]
    assert which(out.with_name("oak.old-1")) == "old"


def test_a_folder_of_others_behind_a_link_stays_theirs(out, tmp_path):
    theirs = tmp_path / "theirs"
    theirs.mkdir()
    (theirs / "thesis.txt").write_text("precious")
    (out / "notes").symlink_to(theirs)
    with pytest.raises(AssetError, match="notes"):
        publish_asset(out, "new")
    publish_as(out, None, force=True)
    assert (out / "notes").readlink() == theirs
    assert (theirs / "thesis.txt").read_text() == "precious"
    assert left_over(out) == []


def test_a_run_that_another_one_replaced_meanwhile_takes_nothing_back(out, monkeypatch):
    take_place, runs = publish._take_place, []

    def be_overtaken(new, target):
        old = take_place(new, target)
        runs.append(1)
        if len(runs) == 1:
            publish_asset(out, "of the other run, which is longer")
        return old

    monkeypatch.setattr(publish, "_take_place", be_overtaken)
    publish_asset(out, "new")
    assert which(out) == "of the other run, which is longer"
    assert left_over(out) == []


def test_an_asset_that_is_written_again_without_an_origin_keeps_that_it_has(tmp_path):
    publish_as(tmp_path / "oak", OAK)
    publish_as(tmp_path / "oak", None)
    assert read_origin(tmp_path / "oak") == OAK


@pytest.mark.usefixtures("any_file_system")
def test_force_keeps_the_files_of_others(out):
    (out / "maps" / "mine.txt").write_text("precious")
    (out / "notes").mkdir()
    (out / "notes" / "link").symlink_to("nowhere")
    publish_as(out, None, force=True)
    assert which(out) == "new"
    assert (out / "maps" / "mine.txt").read_text() == "precious"
    assert (out / "notes" / "link").is_symlink()
    assert foreign_files(out) == ["maps/mine.txt", "notes/link"]  # still not the asset's
    assert left_over(out) == []


def test_a_file_of_others_is_not_lost_to_one_of_the_new_asset(out):
    (out / "new.txt").write_text("precious")

    def write_another():
        with publish_folder(out, force=True) as folder:
            write_asset(folder, "new")
            (folder / "new.txt").touch()

    with pytest.raises(AssetError, match=r"new.txt is not the asset's"):
        write_another()
    assert (out / "new.txt").read_text() == "precious"
    assert which(out) == "old"
    assert left_over(out) == []


@pytest.mark.usefixtures("any_file_system")
def test_a_file_that_appears_at_the_last_moment_is_put_aside(out, monkeypatch, caplog):
    take_place = publish._take_place

    def appear(new, target):
        (out / "mine.txt").write_text("precious")
        return take_place(new, target)

    monkeypatch.setattr(publish, "_take_place", appear)
    publish_asset(out, "new")
    assert which(out) == "new"
    assert left_over(out) == ["oak.old-1"]
    assert [path.name for path in out.with_name("oak.old-1").iterdir()] == ["mine.txt"]
    assert "oak.old-1" in caplog.text


@pytest.mark.usefixtures("any_file_system")
def test_what_is_replaced_is_kept_on_request(out, caplog):
    for number in (1, 2):
        publish_as(out, None, f"new {number}", keep_old=True)
        assert f"oak.old-{number}" in caplog.text
    assert which(out) == "new 2"
    assert which(out.with_name("oak.old-1")) == "old"
    assert which(out.with_name("oak.old-2")) == "new 1"
    assert left_over(out) == ["oak.old-1", "oak.old-2"]


@pytest.mark.usefixtures("any_file_system")
def test_the_old_asset_comes_back_where_the_new_one_is_not_whole(out, monkeypatch):
    take_place, times = publish._take_place, []

    def lose_a_file(new, target):
        old = take_place(new, target)
        if not times:
            (target / "maps" / "which.txt").write_text("")
        times.append(1)
        return old

    monkeypatch.setattr(publish, "_take_place", lose_a_file)
    with pytest.raises(AssetError, match=r"maps/which.txt is not as it was written; what was there is unchanged"):
        publish_asset(out, "new")
    assert which(out) == "old"
    assert left_over(out) == []


@pytest.mark.parametrize("names", [["../thesis.txt"], ["/thesis.txt"], ["link/thesis.txt"]])
def test_a_record_that_lists_files_elsewhere_removes_none_of_them(out, names):
    (out.parent / "thesis").mkdir()
    for thesis in (out.parent / "thesis.txt", out.parent / "thesis" / "thesis.txt"):
        thesis.write_text("precious")
    (out / "link").symlink_to(out.parent / "thesis")
    listed = json.loads((out / FILES_LIST).read_text())["files"]
    (out / FILES_LIST).write_text(json.dumps({"files": [*listed, "link", *names]}))
    publish_asset(out, "new")
    assert (out.parent / "thesis.txt").read_text() == "precious"
    assert (out.parent / "thesis" / "thesis.txt").read_text() == "precious"


@pytest.fixture
def nobody(tmp_path):
    """This process as an ordinary user, who may write into tmp_path."""
    if os.geteuid() != 0:
        pytest.skip("only root can become another user")
    for folder in tmp_path.parents[:3]:  # up to the folder of all runs of this user
        if folder.stat().st_uid == 0 and folder.name.startswith(("pytest-", "popen-")):
            folder.chmod(0o711)
    tmp_path.chmod(0o777)
    groups = os.getgroups()
    os.setgroups([])
    os.setegid(65534)
    os.seteuid(65534)
    yield 65534
    os.seteuid(0)
    os.setegid(0)
    os.setgroups(groups)


def test_an_asset_of_another_user_is_refused_before_anything_is_written(tmp_path, out, nobody):
    os.seteuid(0)
    out.parent.chmod(0o777)
    os.seteuid(nobody)
    with pytest.raises(AssetError, match=r"belongs to root.*argument keep_old"), publish_folder(out):
        pytest.fail("the body must not run")
    assert left_over(out) == []
    publish_as(out, None, keep_old=True)
    assert which(out) == "new"
    assert left_over(out) == ["oak.old-1"]
    os.seteuid(0)
    out.parent.chmod(0o1777)
    os.chown(out, 0, 0)
    os.seteuid(nobody)
    with pytest.raises(AssetError, match=r"belongs to root, who alone may replace it"), publish_folder(out):
        pytest.fail("the body must not run")
    assert left_over(out) == ["oak.old-1"]


@pytest.mark.parametrize("two_renames", [False, True])
def test_a_kill_while_the_old_asset_is_removed_loses_no_file_of_others(out, two_renames):
    (out / "mine.txt").write_text("precious")
    program = textwrap.dedent(f"""
        import os, signal
        from pathlib import Path
        from usdfoliage.asset import publish, replacing
        from tests.asset.test_publish import write_asset

        if {two_renames}:
            publish.exchange = lambda first, second: False
        publish.retire = lambda *words, **more: os.kill(os.getpid(), signal.SIGKILL)
        with publish.publish_folder(Path({str(out)!r}), force=True) as folder:
            write_asset(folder, "new")
    """)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert (out / "mine.txt").read_text() == "precious"
    old = next(path for path in out.parent.iterdir() if path.is_dir() and path != out)
    (old / "late.txt").write_text("precious too")
    with pytest.raises(RuntimeError), publish_folder(out, force=True):
        raise RuntimeError
    assert which(out) == "new"
    assert left_over(out) == ["oak.old-1"]
    assert [path.name for path in out.with_name("oak.old-1").iterdir()] == ["late.txt"]
