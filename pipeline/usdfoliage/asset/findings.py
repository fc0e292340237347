"""What validators find, and what of it a studio has decided to live with."""

from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from usdfoliage.asset.resources import resource_folder
from usdfoliage.errors import AssetError
from usdfoliage.toml_file import read_toml

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


def default_profile() -> Path:
    """The profile that is shipped with usdfoliage."""
    return resource_folder("usd_plugins/usdFoliageValidators") / "studio_profile.toml"


def read_profile(path: Path) -> tuple[Acceptance, ...]:
    """Read the accepted warnings of a studio.

    Raises:
        AssetError: The file is missing, no TOML, or an entry lacks its validator or its reason.
    """
    try:
        content = read_toml(path)
    except (OSError, ValueError) as error:
        raise AssetError(f"the profile {path} cannot be read: {error}") from error
    entries = content.get("accepted", [])
    if set(content) - {"accepted"} or not isinstance(entries, list):
        raise AssetError(f"the profile {path} must hold [[accepted]] entries and nothing else")
    profile = []
    for number, entry in enumerate(entries, 1):
        known = {"validator", "error", "path", "reason"}
        if not isinstance(entry, dict) or set(entry) - known or not all(isinstance(v, str) for v in entry.values()):
            raise AssetError(
                f"the profile {path}, entry {number}: only texts named {', '.join(sorted(known))} are known"
            )
        if not entry.get("validator", "").strip() or not entry.get("reason", "").strip():
            raise AssetError(f"the profile {path}, entry {number}: validator and reason must be given")
        profile.append(Acceptance(**entry))
    return tuple(profile)
