"""What a run reports of its input or its result, as values: reports, terminal and JSON are made of them.

A stage makes a remark with `remark(code, …)`. What it decides by is a code, never the words of a text. The codes, with
what each means and what to do, are listed in `remark_codes`; they are part of what a version promises, as exit codes
are. A remedy names settings, not options: each front end writes a setting as its own user sets it.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from usdfoliage.errors import FoliageError
from usdfoliage.remark_codes import REMARK_KINDS


@dataclass(frozen=True, kw_only=True)
class Setting:
    """A setting that a remedy names.

    Attributes:
        name: Of a build's settings, as branches.internode_m; or of capture.toml, as capture.toml:up_axis.
        value: As TOML; empty where the user must choose it.
    """

    name: str
    value: str = ""

    def __str__(self) -> str:
        """As a plan has it: branches.internode_m = 0.2; or up_axis = "Z" in capture.toml."""
        file, _, key = self.name.rpartition(":")
        text = f"{key} = {self.value}" if self.value else key
        return f"{text} in {file}" if file else text


@dataclass(frozen=True, kw_only=True)
class Argument:
    """What a run is given beside its settings, where a remedy names it: the output, force, a mask. No plan has it.

    Attributes:
        name: Of the field of the run's request.
        value: Empty where the user must choose it, or for a switch.
    """

    name: str
    value: str = ""

    def __str__(self) -> str:
        """As no command in particular has it: the argument mask."""
        return f"the argument {self.name}" + (f" = {self.value}" if self.value else "")


Remedy = tuple[str | Setting | Argument, ...]  # the parts of a sentence
RenderSetting = Callable[[Setting | Argument], str]


@dataclass(frozen=True, kw_only=True)
class Remark:
    """One thing that the user should know.

    Attributes:
        code: One of remark_codes.REMARK_KINDS.
        severity: "warning": it puts the result in question; "info": it does not.
        subject: A photograph, a file, a part of the plant; empty where the remark is about the whole.
        text: One sentence without a full stop, with measured values.
        remedy: What to do about it, as the parts of a sentence; empty where there is nothing to do.
    """

    code: str
    severity: str
    subject: str
    text: str
    remedy: Remedy = ()

    def sentence(self, render: RenderSetting) -> str:
        """Text and remedy as one sentence; render writes a setting as the reader sets it."""
        return f"{self.text}: {write_remedy(self.remedy, render)}" if self.remedy else self.text

    def as_json(self) -> dict[str, Any]:
        """What JSON holds of it."""
        return {
            "code": self.code,
            "severity": self.severity,
            "subject": self.subject,
            "text": self.text,
            "remedy": remedy_as_json(self.remedy),
        }


def remark(code: str, text: str, *, subject: str = "", remedy: str | Remedy = ()) -> Remark:
    """A remark of this code; its severity is that of the code.

    Raises:
        KeyError: There is no such code in remark_codes.
    """
    parts = (remedy,) if isinstance(remedy, str) else remedy
    return Remark(code=code, severity=REMARK_KINDS[code].severity, subject=subject, text=text, remedy=parts)


def remark_from_json(stored: Mapping[str, Any]) -> Remark:
    """A remark as as_json has written it.

    Raises:
        KeyError, TypeError: It is none.
    """
    return Remark(
        code=stored["code"],
        severity=stored["severity"],
        subject=stored["subject"],
        text=stored["text"],
        remedy=remedy_from_json(stored["remedy"]),
    )


def remedy_as_json(remedy: Remedy) -> list[str | dict[str, str]]:
    """What JSON has of a remedy: each part a text, or an object with the name of its setting or argument."""
    return [
        part
        if isinstance(part, str)
        else {"setting" if isinstance(part, Setting) else "argument": part.name, "value": part.value}
        for part in remedy
    ]


def remedy_from_json(stored: Iterable[str | Mapping[str, str]]) -> Remedy:
    """A remedy as remedy_as_json has written it.

    Raises:
        KeyError, TypeError: It is none.
    """
    return tuple(_part_from_json(part) for part in stored)


def _part_from_json(stored: str | Mapping[str, str]) -> str | Setting | Argument:
    if isinstance(stored, str):
        return stored
    if "argument" in stored:
        return Argument(name=stored["argument"], value=stored["value"])
    return Setting(name=stored["setting"], value=stored["value"])


def warnings_of(remarks: Iterable[Remark]) -> tuple[Remark, ...]:
    """Those that put the result in question."""
    return tuple(each for each in remarks if each.severity == "warning")


def infos_of(remarks: Iterable[Remark]) -> tuple[Remark, ...]:
    """Those that do not."""
    return tuple(each for each in remarks if each.severity == "info")


def merge_remarks(*groups: Sequence[Remark]) -> tuple[Remark, ...]:
    """All of them in their order, each once."""
    return tuple(dict.fromkeys(each for group in groups for each in group))


def rename_in(renamed: Remark, rename: Callable[[str], str]) -> Remark:
    """The same remark with files named otherwise, in its subject, text and remedy."""
    return replace(
        renamed,
        subject=rename(renamed.subject),
        text=rename(renamed.text),
        remedy=rename_in_remedy(renamed.remedy, rename),
    )


def rename_in_remedy(remedy: Remedy, rename: Callable[[str], str]) -> Remedy:
    """The same remedy with files named otherwise."""
    return tuple(rename(part) if isinstance(part, str) else part for part in remedy)


def list_sentences(remarks: Iterable[Remark], render: RenderSetting) -> list[str]:
    """Each as a sentence, the warnings first."""
    all_remarks = tuple(remarks)
    return [each.sentence(render) for each in (*warnings_of(all_remarks), *infos_of(all_remarks))]


def label_remarks(remarks: Iterable[Remark], render: RenderSetting) -> list[str]:
    """Lines of a terminal, the warnings first: warning: …, and note: … for what is less than that."""
    all_remarks = tuple(remarks)
    return [
        *(f"warning: {each.sentence(render)}" for each in warnings_of(all_remarks)),
        *(f"note: {each.sentence(render)}" for each in infos_of(all_remarks)),
    ]


def explain_error(error: FoliageError, render: RenderSetting) -> str:
    """What is wrong, and what to do about it."""
    return f"{error.text}; {write_remedy(error.remedy, render)}" if error.remedy else error.text


def write_remedy(remedy: Remedy, render: RenderSetting) -> str:
    """A remedy as text."""
    return "".join(part if isinstance(part, str) else render(part) for part in remedy)


def as_plan_setting(setting: Setting | Argument) -> str:
    """A setting as a build's plan has it; an argument, which no plan has, by its name."""
    return str(setting)
