"""Native settings are filled from dataclasses, and none is forgotten."""

from dataclasses import dataclass

import pytest
from usdfoliage import _native
from usdfoliage.native_settings import native_settings


@dataclass(frozen=True, kw_only=True)
class Settings:
    agree_px: float = 1.5
    other: int = 3


def test_fields_are_copied_by_their_names_and_values_go_first():
    filled = native_settings(_native.AgreementSettings, Settings(), agree_share=0.25)
    assert (filled.agree_px, filled.agree_share) == (1.5, 0.25)
    assert native_settings(_native.AgreementSettings, Settings(), agree_share=0.25, agree_px=2.0).agree_px == 2.0


def test_a_field_that_is_in_neither_is_refused():
    with pytest.raises(TypeError, match="AgreementSettings needs agree_share, which Settings does not have"):
        native_settings(_native.AgreementSettings, Settings())


def test_a_value_of_no_field_is_refused():
    with pytest.raises(TypeError, match="other"):
        native_settings(_native.AgreementSettings, Settings(), agree_share=0.25, other=1)


def test_native_settings_have_no_defaults():
    with pytest.raises(TypeError):
        _native.AgreementSettings(agree_px=1.0)
    with pytest.raises(TypeError):
        _native.AgreementSettings(1.0, 0.01)
