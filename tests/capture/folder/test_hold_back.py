"""Which photographs are withheld."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from usdfoliage.capture.folder.hold_back import check_hold_back, choose_withheld
from usdfoliage.errors import CaptureError

NAMES = [f"{number:03}.jpg" for number in range(10)]


@pytest.mark.parametrize(
    ("every", "withheld"), [(0, []), (2, [2, 4, 6, 8]), (3, [2, 5, 8]), (5, [2, 7]), (8, [2]), (100, [2])]
)
def test_every_so_many_are_withheld_from_the_third_on(every, withheld):
    assert choose_withheld(NAMES, every) == tuple(NAMES[number] for number in withheld)


@given(order=st.permutations(NAMES), every=st.integers(2, 12))
def test_the_order_of_the_names_does_not_matter_and_two_are_always_left(order, every):
    withheld = choose_withheld(order, every)
    assert withheld == choose_withheld(NAMES, every)
    assert len(NAMES) - len(withheld) >= 2


def test_two_photographs_are_too_few():
    with pytest.raises(CaptureError, match="there are 2 photographs, and it takes 3 at least"):
        choose_withheld(NAMES[:2], 2)
    assert choose_withheld(NAMES[:3], 2) == (NAMES[2],)


@pytest.mark.parametrize("every", [1, -1])
def test_neither_all_photographs_nor_fewer_than_none_can_be_withheld(every):
    with pytest.raises(ValueError, match="hold_back must be 0 or at least 2"):
        check_hold_back(every)
