"""What lies apart from a plant, by gaps whose length is known."""

import numpy as np
import pytest
from usdfoliage.branch.tracing.gaps import find_beyond_gaps
from usdfoliage.branch.tracing.sections import SectionTree


def chain(heights_m) -> SectionTree:
    """Sections above each other, one point in each."""
    heights_m = np.asarray(heights_m, float)
    count = len(heights_m)
    return SectionTree(
        center_m=heights_m[:, None] * [0.0, 1, 0],
        points=np.ones(count, np.int32),
        parent=np.arange(-1, count - 1, dtype=np.int32),
        section=np.arange(count, dtype=np.int32),
    )


STEM_M = np.arange(11) * 0.1


@pytest.mark.parametrize(("gap_m", "beyond_m", "lost"), [(0.5, 0.4, True), (0.5, 0.6, False), (0.25, 0.1, False)])
def test_a_gap_is_believed_where_more_lies_beyond_it(gap_m, beyond_m, lost):
    above_m = 1 + gap_m + np.arange(round(beyond_m / 0.1) + 1) * 0.1
    apart = find_beyond_gaps(chain(np.concatenate([STEM_M, above_m])), 0.1, 1.0)
    assert not apart[: len(STEM_M)].any()
    assert apart[len(STEM_M) :].all() == lost
    assert apart.any() == lost


def test_what_lies_beyond_several_gaps_counts_together_without_them():
    heights_m = np.concatenate([STEM_M, 1.5 + np.arange(4) * 0.1, 2.3 + np.arange(4) * 0.1])
    apart = find_beyond_gaps(chain(heights_m), 0.1, 1.0)
    assert not apart[:15].any()  # .5 m of gap before .6 m
    assert apart[15:].all()  # .5 m before .3 m


def test_what_is_kept_keeps_its_parents_and_points():
    tree = chain(STEM_M)
    kept = np.ones(len(tree), bool)
    kept[7:] = False
    left = tree.take(kept)
    assert left.parent.tolist() == [-1, 0, 1, 2, 3, 4, 5]
    assert left.section.tolist() == list(range(7))
