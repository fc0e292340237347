"""A forest in tasks: the bytes of one in one process, wherever they run, and nothing is done twice."""

import json
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from usdfoliage.jobs.plant.store import Store, read_stamp

from tests.support.dask_clusters import dask_cluster
from tests.support.fake_builds import wait_until
from tests.support.forests.shots import PATH_M, forest_words, write_shot
from tests.support.leaves.commands import run
from tests.support.small_builds import digests


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp('it\'s a "forest"; $HOME')
    write_shot(folder / "shot010.usda", [(0, 40, z) for z in PATH_M])
    write_shot(folder / "shot020.usda", [(20, 6, z) for z in PATH_M])  # low enough for grass
    return folder


@pytest.fixture(scope="module")
def words(folder) -> list[str]:
    """In tiles, with two shots, a sky, and an orthophoto on the ground."""
    shots = [f"--camera={folder / name}" for name in ("shot010.usda", "shot020.usda")]
    return [
        *forest_words(folder),
        *shots,
        "--grass-distance=60",
        "--lod-distance",
        "30",
        "70",
        "--sky",
        "120",
        "40",
        "--tile=30",
    ]


@pytest.fixture(scope="module")
def plain(folder, words) -> dict[str, str]:
    """The digests of what one process writes without a work folder."""
    assert run(*words, "-o", folder / "plain" / "valley") == 0
    return digests(folder / "plain" / "valley")


@pytest.fixture(scope="module")
def built(folder, words, plain) -> Path:
    """The folder of a forest that was made of tasks in two processes, beside its work folder."""
    assert run(*words, "-o", folder / "built" / "valley", "--jobs", "2") == 0
    return folder / "built"


def stamps_of(built: Path) -> dict[str, int]:
    """When each task was done, by its name."""
    store = Store(folder=built / ".usdfoliage")
    found = {}
    for path in (store.folder / "tasks").glob("*.json"):
        stamp = read_stamp(store, path.stem)
        assert stamp is not None
        found[stamp.name] = path.stat().st_mtime_ns
    return found


def result_of(built: Path, name: str) -> Path:
    store = Store(folder=built / ".usdfoliage")
    stamps = [read_stamp(store, path.stem) for path in (store.folder / "tasks").glob("*.json")]
    (key,) = [stamp.key for stamp in stamps if stamp is not None and stamp.name == name]
    return store.result(key)


def changed(before: dict[str, int], after: dict[str, int]) -> set[str]:
    return {name for name, when in after.items() if before.get(name) != when}


def test_processes_write_what_one_writes(built, plain):
    assert digests(built / "valley") == plain
    assert sum(name.endswith("grass_shot020.usdc") for name in plain) >= 2
    assert any(name.endswith("plants_shot010.usdc") for name in plain)
    assert {"maps/valley_sky.exr", "maps/valley_contact.png"} <= plain.keys()
    tiles = {name for name in stamps_of(built) if name.startswith("tiles/")}
    assert len(tiles) == len(list((built / "valley" / "payload" / "tiles").iterdir())) >= 9


def test_a_forest_in_one_piece_is_made_of_tasks_too(folder, words, capfd):
    capfd.readouterr()
    whole = [word for word in words if word != "--tile=30"]
    assert run(*whole, "-o", folder / "one" / "valley") == 0
    assert run(*whole, "-o", folder / "of tasks" / "valley", "--work", folder / "of tasks" / "work") == 0
    assert digests(folder / "of tasks" / "valley") == digests(folder / "one" / "valley")
    assert "Could not open" not in capfd.readouterr().err  # by USD, of a layer that is not there yet


def test_dask_writes_what_one_process_writes(folder, words, plain, tmp_path):
    with dask_cluster(tmp_path) as cluster:
        assert run(*words, "-o", folder / "dask" / "valley", "--scheduler", cluster.address) == 0
    assert digests(folder / "dask" / "valley") == plain


def test_what_is_done_is_not_done_again(folder, words, plain, built):
    shutil.copytree(built, folder / "again", copy_function=shutil.copy2)
    again = folder / "again"
    command = [*words, "-o", again / "valley"]
    assert run(*command, "--work", again / ".usdfoliage") == 0
    before = stamps_of(again)
    assert run(*command, "--work", again / ".usdfoliage") == 0
    assert changed(before, stamps_of(again)) == set()
    # Where the sun is decides no tile.
    assert run(*command, "--work", again / ".usdfoliage", "--sky", "200", "20") == 0
    assert changed(before, stamps_of(again)) == set()
    assert digests(again / "valley")["maps/valley_sky.exr"] != plain["maps/valley_sky.exr"]


def test_a_tile_that_was_altered_is_written_again_alone(folder, words, plain, built):
    there = folder / "altered"
    shutil.copytree(built, there, copy_function=shutil.copy2)
    before = stamps_of(there)
    layer = next((result_of(there, "tiles/3") / "asset").rglob("terrain.usdc"))
    layer.write_bytes(layer.read_bytes()[:-1] + bytes([layer.read_bytes()[-1] ^ 1]))
    assert run(*words, "-o", there / "valley", "--work", there / ".usdfoliage") == 0
    assert changed(before, stamps_of(there)) == {"tiles/3"}
    assert digests(there / "valley") == plain


def test_a_planted_forest_that_was_damaged_is_planted_again(folder, words, plain, built):
    there = folder / "damaged"
    shutil.copytree(built, there, copy_function=shutil.copy2)
    before = stamps_of(there)
    (result_of(there, "planting") / "planted" / "outline.json").write_text('{"tiles": 3}')
    (result_of(there, "tiles/2") / "tile.json").unlink()
    assert run(*words, "-o", there / "valley", "--work", there / ".usdfoliage") == 0
    assert changed(before, stamps_of(there)) == {"planting", "tiles/2"}
    assert digests(there / "valley") == plain


def test_a_killed_run_goes_on(folder, words, plain):
    there = folder / "killed"
    command = [*words, "-o", there / "valley", "--work", there / ".usdfoliage"]
    killed = subprocess.Popen([sys.executable, "-m", "usdfoliage", *map(str, command)], stdout=subprocess.DEVNULL)
    wait_until(lambda: len(list((there / ".usdfoliage" / "tasks").glob("*.json"))) >= 3)
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    assert not (there / "valley").exists()
    before = stamps_of(there)
    assert "planting" in before
    assert run(*command) == 0
    assert changed(before, stamps_of(there)).isdisjoint(before)
    assert digests(there / "valley") == plain
    assert not [path for path in (there / ".usdfoliage" / "results").iterdir() if path.name.startswith(".")]


def test_another_height_plants_the_forest_again(folder, words):
    """Keys are of bytes: a file of the same size and time that holds something else is noticed."""
    there = folder / "changed"
    shutil.copytree(folder / "oak", there / "oak")
    plants = there / "plants.toml"
    given = next(Path(word.partition("=")[2]) for word in words if word.startswith("--plants="))
    plants.write_text(given.read_text())
    command = [word if not word.startswith("--plants=") else f"--plants={plants}" for word in words]
    command += ["-o", there / "valley", "--work", there / "work"]
    assert run(*command) == 0
    done = {path.name for path in (there / "work" / "tasks").glob("*.json")}
    plants.write_text(plants.read_text() + "\n# a remark\n")
    assert run(*command) == 0
    now = {path.name for path in (there / "work" / "tasks").glob("*.json")}
    assert len(now) == 2 * len(done)
    # So is an asset of a plant, which lies beside.
    payload = there / "oak" / "payload" / "payload.usda"
    payload.write_text(payload.read_text() + "\n# a remark\n")
    assert run(*command) == 0
    assert len({path.name for path in (there / "work" / "tasks").glob("*.json")}) == 3 * len(done)


def test_a_dem_that_cannot_be_read_is_one_error_and_leaves_no_asset(folder, words, capsys):
    broken = folder / "broken.tif"
    broken.write_bytes(b"II*\x00" + b"\xff" * 60)
    command = ["forest", broken, *words[2:], "-o", folder / "none" / "valley", "--jobs", "2"]
    capsys.readouterr()
    assert run(*command) == 2
    errors = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error:")]
    assert len(errors) == 1
    assert "broken.tif" in errors[0]
    assert not (folder / "none" / "valley").exists()


def test_prune_keeps_what_a_forest_needs(built, capsys):
    before = stamps_of(built)
    assert run("work", built / ".usdfoliage", "--prune") == 0
    assert stamps_of(built) == before
    capsys.readouterr()
    assert run("work", built / ".usdfoliage") == 0
    assert "planting" in capsys.readouterr().out


def test_the_record_of_a_forest_names_what_it_is_made_of(built):
    (record,) = (built / ".usdfoliage" / "builds").glob("*.json")
    stored = json.loads(record.read_text())
    assert stored["capture"].endswith("dem.tif")
    assert {task["stage"] for task in stored["tasks"]} == {"planting", "tiles"}
