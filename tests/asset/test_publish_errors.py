"""What an error of the system names where an asset is written: the file at fault, as the user knows it."""

import errno

import pytest
from usdfoliage.asset.publish import publish_folder
from usdfoliage.errors import FoliageError, WriteError


def test_a_file_that_is_read_meanwhile_is_named_instead_of_the_output(tmp_path):
    photo = tmp_path / "leaf.jpg"
    with pytest.raises(FoliageError) as refused, publish_folder(tmp_path / "oak"):
        raise PermissionError(errno.EACCES, "Permission denied", str(photo))
    assert refused.value.text == f"{photo} cannot be used: its permissions do not allow it"
    assert list(tmp_path.iterdir()) == []


def test_a_file_of_the_asset_has_the_name_that_the_user_knows(tmp_path):
    with pytest.raises(WriteError) as refused, publish_folder(tmp_path / "oak") as new:
        raise PermissionError(errno.EACCES, "Permission denied", str(new / "maps" / "leaf.png"))
    assert refused.value.path == tmp_path / "oak" / "maps" / "leaf.png"
    assert list(tmp_path.iterdir()) == []
