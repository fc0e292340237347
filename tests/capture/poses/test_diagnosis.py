"""Why a photograph has no camera."""

from types import SimpleNamespace

import numpy as np
import pytest
from usdfoliage.capture.poses.diagnosis import list_failures
from usdfoliage.capture.poses.result import PairMatches


@pytest.mark.parametrize(
    ("used", "reason"),
    [
        (None, "200 features in common with the best of the others, too few of them on points"),
        ([(0, 1), (1, 2), (0, 3)], "2 of its 3 pairs contradict those of the other photographs"),
        ([(0, 1), (0, 3), (1, 3), (2, 3)], "200 features in common"),
    ],
)
def test_a_photograph_whose_pairs_contradict_the_others(tmp_path, used, reason):
    """The fourth has no camera, and overlaps all others."""
    verified = np.zeros((4, 4), np.int64)
    verified[3, :3] = verified[:3, 3] = 200, 150, 100
    np.savez(tmp_path / "features.npz", keypoints=np.zeros((900, 4)))
    found = PairMatches(verified=verified, similar=verified, panoramic=np.zeros((4, 4), bool))
    photo_set = SimpleNamespace(photos=[SimpleNamespace(name=f"{k}.jpg") for k in range(4)], blurred=(), dropped=())
    (failure,) = list_failures(
        photo_set,
        [tmp_path / "features.npz"] * 4,
        np.array([0, 0, 0, -1]),
        found,
        {},
        15,
        None if used is None else np.array(used),
    )
    assert failure.name == "3.jpg"
    assert failure.reason.startswith(reason)
