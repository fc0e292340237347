"""The file of a crown that stages hand on."""

from dataclasses import fields

import numpy as np
from usdfoliage.crown.model import CrownModel
from usdfoliage.crown.model_file import MadeCrown, read_crown_model, write_crown_model

from tests.support.model_files import check_model_file
from tests.support.plant_assets import round_crown


def test_a_crown_comes_back(tmp_path):
    made = MadeCrown(model=round_crown(), overlap=0.8)
    found = check_model_file(tmp_path, made, write_crown_model, read_crown_model, "radius_m")
    assert found.overlap == 0.8
    for field in fields(CrownModel):
        one, other = getattr(found.model, field.name), getattr(made.model, field.name)
        assert np.array_equal(one, other), field.name
        assert not isinstance(other, np.ndarray) or one.dtype == other.dtype
