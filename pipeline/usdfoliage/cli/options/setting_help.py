"""What the help of an option states of a setting: its meaning, unit, range and default, from the settings class."""

from collections.abc import Hashable
from typing import cast

from usdfoliage.jobs.work.field_comments import field_comments, split_comment
from usdfoliage.jobs.work.settings_file import format_value


def describe_setting(settings: object, name: str) -> str:
    """The help of an option that sets this field: the comment beside the field, and its value as the default.

    Args:
        settings: A settings dataclass with its defaults.
        name: A field of it.
    """
    meaning, unit, allowed = split_comment(field_comments(cast(Hashable, type(settings))).get(name, ""))
    if " to " in allowed and " or " not in allowed and allowed[0].isdigit():
        allowed = f"from {allowed}"
    default = state_default(getattr(settings, name))
    value = ", ".join([*([f"in {unit}"] if unit else []), *([allowed] if allowed else [])])
    facts = [*([f"the value is {value}"] if value else []), *([f"the default is {default}"] if default else [])]
    text = "; ".join(facts)
    sentence = f"{text[0].upper()}{text[1:]}." if text else ""
    return f"{meaning} {sentence}".strip().replace("%", "%%")  # argparse formats a help with %


def state_default(value: object) -> str:
    """A default as the command line takes it: auto for None, numbers with spaces between them; empty for no text."""
    if isinstance(value, tuple):
        return " ".join(state_default(each) for each in value)
    return f"{value:g}" if isinstance(value, float) else format_value(value).strip('"')
