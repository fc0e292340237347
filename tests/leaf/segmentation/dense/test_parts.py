"""Parts of patches between creases, steps and necks."""

import numpy as np
import pytest
from usdfoliage.leaf.segmentation.dense.parts import PartSettings, find_creases, find_steps, part_at_necks
from usdfoliage.leaf.segmentation.dense.patches import LocalPlanes


def discs(*centers, radius=20, shape=(80, 160)):
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    return np.any([(rows - y) ** 2 + (columns - x) ** 2 <= radius**2 for y, x in centers], axis=0)


def planes(shape, right=None, down=None):
    nothing = np.zeros(shape, np.float32)
    return LocalPlanes(
        slopes=np.zeros((*shape, 3), np.float32),
        support=nothing,
        gap_right=nothing if right is None else right,
        gap_down=nothing if down is None else down,
    )


def test_discs_that_touch_are_parted_in_the_middle():
    patches = discs((40, 45), (40, 80)).astype(np.int32)
    parts = part_at_necks(patches, np.zeros(patches.shape, bool), 16, 10)
    assert sorted(np.unique(parts)) == [0, 1, 2]
    assert parts[40, 45] != parts[40, 80]
    assert ((parts > 0) == (patches > 0)).all()
    middle = np.flatnonzero(np.diff(parts[40, 30:95]))
    assert middle + 30 == pytest.approx(np.array([62.0]), abs=1)
    # A disc that fits through the neck parts nothing.
    assert part_at_necks(patches, np.zeros(patches.shape, bool), 5, 10).max() == 1


def test_parts_stay_within_their_patch():
    patches = discs((40, 45)).astype(np.int32) + 2 * discs((40, 95)).astype(np.int32)
    parts = part_at_necks(patches, np.zeros(patches.shape, bool), 10, 10)
    assert len(np.unique(parts[patches == 1])) == len(np.unique(parts[patches == 2])) == 1
    assert parts[40, 45] != parts[40, 95]


def test_a_step_parts_what_no_neck_does():
    patches = np.ones((80, 160), np.int32)
    right = np.zeros(patches.shape, np.float32)
    right[:70, 79] = 3.0  # open below
    steps = find_steps(planes(patches.shape, right=right), 1.0)
    assert steps[:70, 79:81].all()
    assert not steps[:, :79].any()
    assert not steps[:, 81:].any()
    assert part_at_necks(patches, np.zeros(patches.shape, bool), 20, 10).max() == 1
    assert part_at_necks(patches, steps, 20, 10).max() == 2
    assert not find_steps(planes(patches.shape, right=right), 4.0).any()


def test_specks_of_a_step_part_nothing():
    patches = discs((40, 80), radius=30).astype(np.int32)
    steps = np.zeros(patches.shape, bool)
    steps[39:42, 79:82] = True
    assert (part_at_necks(patches, steps, 20, 10) > 0)[40, 80]
    whole = part_at_necks(patches, np.zeros(patches.shape, bool), 20, 10)
    assert np.array_equal(part_at_necks(patches, steps, 20, 10), whole)


def test_small_parts_are_dropped():
    patches = discs((40, 45), (40, 80)).astype(np.int32)
    parts = part_at_necks(patches, np.zeros(patches.shape, bool), 16, 5000)
    assert not parts.any()
    assert not part_at_necks(np.zeros((20, 20), np.int32), np.zeros((20, 20), bool), 3, 1).any()


def test_a_crease_is_where_the_surface_turns():
    normals = np.zeros((30, 40, 3), np.float32)
    normals[..., 2] = 1
    turn = np.radians(30)
    normals[:, 20:] = 0, np.sin(turn), np.cos(turn)
    crease = find_creases(normals, 20, 3)
    assert crease[:, 18:22].all()
    assert not crease[:, :18].any()
    assert not crease[:, 22:].any()
    assert not find_creases(normals, 31, 3).any()


def test_settings_are_checked():
    with pytest.raises(ValueError, match="above 0"):
        PartSettings(gap=0.0)
    with pytest.raises(ValueError, match="above 0"):
        PartSettings(wide=(0.1, -1.0))
