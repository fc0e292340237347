"""A planted forest that goes through files and comes back bit for bit."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from usdfoliage.errors import CaptureError
from usdfoliage.forest.grass import GrassSettings
from usdfoliage.forest.shots import ShotSettings
from usdfoliage.jobs.forest.grass import GrassRequest
from usdfoliage.jobs.forest.inputs import ForestFiles
from usdfoliage.jobs.forest.planted import plant_tiles
from usdfoliage.jobs.forest.planted_file import OUTLINE, read_outline, read_tile, write_planted
from usdfoliage.jobs.forest.request import ForestRequest
from usdfoliage.jobs.forest.shots import ShotRequest

from tests.support.forests.shots import PATH_M, forest_words, write_shot


@pytest.fixture(scope="module")
def planted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("planted")
    words = forest_words(folder)
    files = {name: Path(path) for name, path in (word[2:].split("=") for word in words if "=" in word)}
    shot = write_shot(folder / "shot010.usda", [(0, 40, z) for z in PATH_M])
    low = write_shot(folder / "shot020.usda", [(20, 6, z) for z in PATH_M])
    request = ForestRequest(
        files=ForestFiles(dem=Path(words[1]), **files),
        output=folder / "valley",
        name="valley",
        tile_m=30.0,
        lod_distance_m=(30.0, 70.0),
        shots=ShotRequest(files=(shot, low), settings=ShotSettings(lod_distance_m=(30.0, 70.0))),
        grass=GrassRequest(settings=GrassSettings(distance_m=60.0)),
    )
    (folder / "out").mkdir()
    return plant_tiles(request, folder / "out", {})


def same(one, other) -> bool:
    """Whether two values are equal to the last bit, arrays and their kinds too."""
    if dataclasses.is_dataclass(one):
        return type(one) is type(other) and all(
            same(getattr(one, each.name), getattr(other, each.name)) for each in dataclasses.fields(one)
        )
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return bool(one == other)


def test_tiles_and_outline_come_back_bit_for_bit(planted, tmp_path):
    write_planted(tmp_path, planted)
    assert same(read_outline(tmp_path), planted.outline)
    assert [tile.name for tile in planted.tiles] == list(planted.outline.tiles)
    hidden = clumps = 0
    for tile in planted.tiles:
        assert same(read_tile(tmp_path, tile.name), tile)
        hidden += sum(len(level.hidden) for shot in tile.shots for level in shot.levels)
        clumps += sum(len(shot.grass) for shot in tile.shots if shot.grass is not None)
    assert clumps
    assert hidden  # plants that change their form in a shot are among them


def test_the_same_forest_gives_the_same_bytes(planted, tmp_path):
    for name in ("one", "two"):
        write_planted(tmp_path / name, planted)
    files = sorted(path.relative_to(tmp_path / "one") for path in (tmp_path / "one").rglob("*") if path.is_file())
    assert len(files) == len(planted.tiles) + 1
    assert all((tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes() for file in files)


@pytest.mark.parametrize("text", ["", "[]", "{", '{"tiles": 3}', '{"tiles": [], "levels": []}'])
def test_an_outline_that_is_none_is_refused(tmp_path, text):
    (tmp_path / OUTLINE).write_text(text)
    with pytest.raises(CaptureError, match="holds no outline of a forest"):
        read_outline(tmp_path)


def test_a_tile_that_was_altered_or_is_gone_is_refused(planted, tmp_path):
    write_planted(tmp_path, planted)
    first, second = (tmp_path / "tiles" / f"{tile.name}.npz" for tile in planted.tiles[:2])
    data = bytearray(first.read_bytes())
    data[len(data) // 2] ^= 1
    first.write_bytes(data)
    second.unlink()
    for tile in planted.tiles[:2]:
        with pytest.raises(CaptureError, match="holds no tile of a forest"):
            read_tile(tmp_path, tile.name)
