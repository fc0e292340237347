"""The work folder of builds: what counts as a result, and what does not."""

import json
import multiprocessing
import os
from pathlib import Path

import pytest
from usdfoliage.errors import FoliageError
from usdfoliage.jobs.plant.store import (
    Stamp,
    Store,
    copy_tree,
    drop_result,
    fill_result,
    find_finished,
    list_files,
    lock_task,
    read_stamp,
    write_stamp,
)

KEY = "k" * 32


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(folder=tmp_path / "work")


def finish(store: Store, key: str = KEY, text: str = "leaves") -> Stamp:
    with fill_result(store, key) as folder:
        (folder / "deeper").mkdir()
        (folder / "deeper" / "result.txt").write_text(text)
    files = list_files(store, store.result(key))
    stamp = Stamp(key=key, name="leaves", stage="leaves", step="leaves", seconds=1.5, estimate_s=2.0, files=files)
    write_stamp(store, stamp)
    return stamp


def test_a_finished_task_is_found_with_its_whole_stamp(store: Store) -> None:
    assert find_finished(store, KEY, thorough=True) is None
    stamp = finish(store)
    assert find_finished(store, KEY, thorough=True) == stamp
    assert [file.path for file in stamp.files] == [f"results/{KEY}/deeper/result.txt"]


@pytest.mark.parametrize("harm", ["gone", "cut", "altered", "folder"])
def test_a_file_that_is_not_as_it_was_makes_its_task_undone(store: Store, harm: str) -> None:
    finish(store)
    file = store.result(KEY) / "deeper" / "result.txt"
    if harm == "altered":
        file.write_text("LEAVES")  # of the same length: only its bytes differ
        assert find_finished(store, KEY, thorough=False) is not None
    elif harm == "cut":
        file.write_text("lea")
    else:
        file.unlink()
        if harm == "folder":
            file.mkdir()
    assert find_finished(store, KEY, thorough=True) is None


@pytest.mark.parametrize("harm", ["cut", "altered", "other key", "no object"])
def test_a_stamp_that_was_changed_is_none(store: Store, harm: str) -> None:
    finish(store)
    path = store.stamp(KEY)
    text = path.read_text()
    if harm == "cut":
        path.write_text(text[: len(text) // 2])
    elif harm == "altered":
        changed = json.loads(text)
        changed["stamp"]["files"] = []  # as if it had made nothing
        path.write_text(json.dumps(changed))
    elif harm == "other key":
        store.stamp("m" * 32).write_text(text)
        assert read_stamp(store, "m" * 32) is None
        return
    else:
        path.write_text("[1, 2]")
    assert read_stamp(store, KEY) is None


def test_a_result_appears_whole_or_not_at_all(store: Store) -> None:
    def fail() -> None:
        with fill_result(store, KEY) as folder:
            (folder / "half.txt").write_text("half")
            raise ValueError("stop")

    with pytest.raises(ValueError, match="stop"):
        fail()
    assert list((store.folder / "results").iterdir()) == []


def test_a_result_takes_the_place_of_a_damaged_one(store: Store) -> None:
    finish(store)
    (store.result(KEY) / "deeper" / "surplus.txt").write_text("surplus")
    finish(store, text="again")
    assert [path.name for path in store.result(KEY).rglob("*.txt")] == ["result.txt"]
    assert find_finished(store, KEY, thorough=True) is not None


def hold(
    folder: Path, locked: "multiprocessing.synchronize.Event", let_go: "multiprocessing.synchronize.Event"
) -> None:
    with lock_task(Store(folder=folder), KEY):
        locked.set()
        let_go.wait(30)


def test_a_task_is_of_one_run_at_a_time(store: Store) -> None:
    context = multiprocessing.get_context("spawn")
    locked, let_go = context.Event(), context.Event()
    other = context.Process(target=hold, args=(store.folder, locked, let_go))
    other.start()
    assert locked.wait(60)
    waiting, got = context.Event(), context.Event()
    third = context.Process(target=hold, args=(store.folder, got, waiting))
    third.start()
    assert not got.wait(1.0)
    let_go.set()
    assert got.wait(30)
    waiting.set()
    other.join()
    third.join()


def test_the_lock_of_a_killed_run_is_free(store: Store) -> None:
    context = multiprocessing.get_context("spawn")
    locked, let_go = context.Event(), context.Event()
    other = context.Process(target=hold, args=(store.folder, locked, let_go))
    other.start()
    assert locked.wait(60)
    other.kill()
    other.join()
    with lock_task(store, KEY):
        pass


def test_a_work_folder_that_cannot_be_is_named(tmp_path: Path) -> None:
    (tmp_path / "work").write_text("a file")
    with (
        pytest.raises(FoliageError, match=r"work.*cannot be written.*another work folder"),
        lock_task(Store(folder=tmp_path / "work"), KEY),
    ):
        pass


def test_a_copy_can_be_changed_without_changing_what_it_is_of(tmp_path: Path) -> None:
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "a" / "b" / "c.txt").write_text("one")
    copy_tree(tmp_path / "a", tmp_path / "copy")
    copy_tree(tmp_path / "a", tmp_path / "link", link=True)
    (tmp_path / "copy" / "b" / "c.txt").write_text("two")
    assert (tmp_path / "a" / "b" / "c.txt").read_text() == "one"
    assert (tmp_path / "a" / "b" / "c.txt").samefile(tmp_path / "link" / "b" / "c.txt")


def test_a_result_that_another_run_stamped_meanwhile_stays(store: Store) -> None:
    with fill_result(store, KEY) as folder:  # as without locks
        (folder / "result.txt").write_text("mine")
        stamp = finish(store)
    assert find_finished(store, KEY, thorough=True) == stamp
    drop_result(store, KEY)
    assert find_finished(store, KEY, thorough=True) == stamp
    assert [path.name for path in (store.folder / "results").iterdir()] == [KEY]


def test_the_files_of_a_result_are_listed_before_it_is_whole(store: Store) -> None:
    with fill_result(store, KEY) as folder:
        (folder / "result.txt").write_text("leaves")
        listed = list_files(store, folder, store.result(KEY))
    assert listed == list_files(store, store.result(KEY))


@pytest.mark.parametrize("harm", ["deep", "pipe"])
def test_a_stamp_that_would_take_the_stack_or_the_time_is_none(store: Store, harm: str) -> None:
    finish(store)
    if harm == "deep":
        store.stamp(KEY).write_text("[" * 100_000)
    else:
        store.stamp(KEY).unlink()
        os.mkfifo(store.stamp(KEY))
    assert read_stamp(store, KEY) is None


@pytest.mark.parametrize("link", [False, True])
def test_a_copy_of_relative_links_holds_the_files_that_they_lead_to(tmp_path: Path, link: bool) -> None:
    (tmp_path / "published").mkdir()
    (tmp_path / "published" / "1.exr").write_text("depth")
    (tmp_path / "capture" / "depth").mkdir(parents=True)
    (tmp_path / "capture" / "depth" / "1.exr").symlink_to("../../published/1.exr")
    laid_out = tmp_path / "work" / "results" / "key" / "depth"
    copy_tree(tmp_path / "capture" / "depth", laid_out, link=link)
    assert (laid_out / "1.exr").read_text() == "depth"
    assert not (laid_out / "1.exr").is_symlink()


@pytest.mark.parametrize("link", [False, True])
def test_a_link_to_nothing_is_not_copied_but_named(tmp_path: Path, link: bool) -> None:
    (tmp_path / "depth").mkdir()
    (tmp_path / "depth" / "1.exr").symlink_to("../published/1.exr")
    with pytest.raises(FoliageError, match=r"depth/1\.exr is a link to \.\./published/1\.exr, which is not there"):
        copy_tree(tmp_path / "depth", tmp_path / "copy", link=link)
