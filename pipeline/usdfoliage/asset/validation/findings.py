"""What validators find, and which of these findings a studio accepts."""

from dataclasses import dataclass
from fnmatch import fnmatchcase

SEVERITIES = ("error", "warning", "info")


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Something that a validator reports of an asset.

    Attributes:
        severity: One of SEVERITIES: error, warning, info.
        validator: Such as usdGeomValidators:StageMetadataChecker or nvidia:KindChecker.
        error: The rule, as the validator names it; empty where it has no name.
        path: A prim or property, / for the stage, or a layer's file where it is about a layer.
        message: What is wrong.
        where: The variant selections in which it was found; empty for all.
        accepted: The reason for which the profile accepts it; empty where it does not.
    """

    severity: str
    validator: str
    error: str
    path: str
    message: str
    where: str = ""
    accepted: str = ""


@dataclass(frozen=True, kw_only=True)
class Acceptance:
    """Warnings that a studio has decided to live with."""

    validator: str
    error: str = "*"
    path: str = "*"  # may hold * and ?
    reason: str

    def accepts(self, finding: Finding) -> bool:
        """Whether it is such a warning. An error is never accepted."""
        return (
            finding.severity != "error"
            and finding.validator == self.validator
            and self.error in ("*", finding.error)
            and fnmatchcase(finding.path, self.path)
        )


def one_line(message: str, place: str) -> str:
    """A validator's message without line breaks, and without the place where it begins with that."""
    return " ".join(message.split()).removeprefix(f"<{place}> ")
