"""What the interface writes passes the gate: nothing that is read lies in what is replaced, with force too."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from usdfoliage import api
from usdfoliage.asset.asset_record import is_asset_folder

from tests.support.small_builds import digests


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    path = tmp_path / "studio" / "leaf.png"
    path.parent.mkdir()
    cv2.imwrite(str(path), np.full((8, 8, 3), 90, np.uint8))
    return path


def write(folder: Path, **more) -> Path:
    return api.write_asset(folder, leaves=api.scatter_leaves(3), representations=("bezier",), **more).asset


@pytest.mark.parametrize("kind", ["itself", "above", "link"])
def test_no_asset_replaces_the_picture_that_it_reads(picture: Path, tmp_path: Path, kind: str) -> None:
    (tmp_path / "link").symlink_to(picture.parent)
    output = {"itself": picture, "above": picture.parent, "link": tmp_path / "link"}[kind]
    before = picture.read_bytes()
    for name in ("texture", "jitter_map"):
        with pytest.raises(api.AssetError, match=r"is read, and .* which would be replaced"):
            write(output, appearance=api.LeafAppearance(**{name: picture}), force=True)
    assert picture.read_bytes() == before
    assert [path.name for path in picture.parent.iterdir()] == ["leaf.png"]


def test_an_asset_that_is_written_again_keeps_its_pictures(picture: Path, tmp_path: Path) -> None:
    written = write(tmp_path / "fern", appearance=api.LeafAppearance(texture=picture))
    before = digests(tmp_path / "fern")
    opened = api.open_asset(written)
    assert opened.appearance.texture is not None
    assert opened.appearance.texture.is_relative_to(tmp_path / "fern")
    write(tmp_path / "fern", appearance=opened.appearance)
    assert digests(tmp_path / "fern") == before


def test_no_bake_replaces_what_it_reads(tmp_path: Path) -> None:
    asset = write(tmp_path / "studio" / "fern")
    look = api.write_look(tmp_path / "studio" / "look.usda", asset, api.LeafEdits(width=2))
    for output in (tmp_path / "studio", tmp_path / "studio" / "fern" / "payload" / "new", look):
        before = digests(tmp_path / "studio")
        with pytest.raises(api.AssetError, match="would be replaced"):
            api.bake(look, output, force=True)
        assert digests(tmp_path / "studio") == before
    assert is_asset_folder(api.bake(look, tmp_path / "studio" / "fern").asset.parent)  # itself it may


def test_no_look_replaces_what_it_reads_or_lies_in_an_asset(picture: Path, tmp_path: Path) -> None:
    asset = write(tmp_path / "fern")
    other = write(tmp_path / "oak")
    wave = shutil.copy(picture, tmp_path / "wave.usda")  # a picture all the same
    before = digests(tmp_path)
    for path, text in (
        (asset, "lies in the asset"),
        (other.parent / "look.usda", "lies in the asset"),
        (wave, "is read, and"),
    ):
        with pytest.raises(api.AssetError, match=text):
            api.write_look(path, asset, api.LeafEdits(jitter_amplitude=0.1), jitter_map=wave, force=True)
    assert digests(tmp_path) == before
