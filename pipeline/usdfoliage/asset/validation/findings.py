"""What validators find, and what of it a studio has decided to live with."""

from dataclasses import dataclass
from fnmatch import fnmatchcase

SEVERITIES = ("error", "warning", "info")


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Something that a validator says of an asset."""

    severity: str  # one of SEVERITIES
    validator: str  # "usdGeomValidators:StageMetadataChecker", "nvidia:KindChecker"
    error: str  # the rule, as the validator names it; empty where it has no name
    path: str  # prim or property, "/" for the stage; a layer's file where it is about a layer
    message: str
    where: str = ""  # the variant selections in which it was found, empty for all
    accepted: str = ""  # the reason for which the profile accepts it, empty where it does not


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
