"""Planes in half the bytes."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from usdfoliage.capture.mvs.packed_planes import pack_planes, reader_of_planes, unpack_planes
from usdfoliage.capture.mvs.patch_match import MatchedPlanes

from tests.support.stereo_pictures import CAMERAS


def planes(seed: int, scale: float = 1.0) -> MatchedPlanes:
    rng = np.random.default_rng(seed)
    inverse = rng.uniform(0.2, 5, (6, 8, 1)) * scale
    slopes = inverse * rng.uniform(-0.1, 0.1, (6, 8, 2))
    found = np.concatenate([inverse, slopes], axis=2).astype(np.float32)
    found[0] = 0
    cost = rng.uniform(0, 2, (6, 8)).astype(np.float32)
    return MatchedPlanes(camera=CAMERAS[0].resized(8, 6), planes=found, cost=cost)


@given(seed=st.integers(0, 1000), scale=st.sampled_from([1e-4, 1.0, 1e4]))
def test_depth_is_kept_exactly_and_slopes_by_three_digits(seed: int, scale: float) -> None:
    matched = planes(seed, scale)
    again = unpack_planes(pack_planes(matched), CAMERAS[0])
    assert np.array_equal(again.planes[..., 0], matched.planes[..., 0])
    inverse = matched.planes[..., :1]
    assert np.all(np.abs(again.planes - matched.planes) <= 1e-4 * inverse)
    assert not again.planes[0].any()
    np.testing.assert_allclose(again.cost, matched.cost, atol=1e-3)
    assert (again.camera.width_px, again.camera.height_px) == (8, 6)


def test_packing_twice_changes_nothing_more() -> None:
    once = unpack_planes(pack_planes(planes(1)), CAMERAS[0])
    twice = unpack_planes(pack_planes(once), CAMERAS[0])
    np.testing.assert_allclose(twice.planes, once.planes, rtol=1e-3)


def test_a_packed_pixel_takes_ten_bytes() -> None:
    packed = pack_planes(planes(2))
    assert packed.inverse.nbytes + packed.slopes.nbytes + packed.cost.nbytes == 10 * 6 * 8
    assert packed.inverse.base is None  # and keeps nothing larger alive


def test_a_view_without_planes_has_none() -> None:
    read = reader_of_planes([None, pack_planes(planes(3))], CAMERAS[:2])
    assert read(0) is None
    assert read(1) is not None
