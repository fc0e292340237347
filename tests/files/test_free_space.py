import errno

import pytest
from usdfoliage.errors import CaptureError
from usdfoliage.files.free_space import is_full_disk, require_space


def test_a_full_disk_is_known_by_the_number_of_the_error_or_of_its_cause():
    full = OSError(errno.ENOSPC, "no words that matter")
    assert is_full_disk(full)
    assert is_full_disk(OSError(errno.EDQUOT, "a quota"))
    assert not is_full_disk(OSError(errno.EACCES, "No space left on device"))
    caused = CaptureError("it was not written")
    assert not is_full_disk(caused)
    caused.__cause__ = full
    assert is_full_disk(caused)


def test_a_trial_finds_a_full_disk_and_leaves_nothing(tmp_path, small_disk):
    require_space(tmp_path)
    with pytest.raises(OSError, match="space") as refused:
        require_space(small_disk)
    assert is_full_disk(refused.value)
    assert list(small_disk.iterdir()) == []
