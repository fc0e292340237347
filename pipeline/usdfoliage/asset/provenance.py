"""Where an asset comes from: what is written of it into the asset."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path, PurePosixPath
from typing import Any

from pxr import Sdf

from usdfoliage.asset.look_layer import CUSTOM_DATA_KEY
from usdfoliage.files.hashing import digest_text
from usdfoliage.files.json import read_json
from usdfoliage.files.unwritten import describe_unwritten

PROVENANCE_FILE = "report/provenance.json"  # of an asset, where the record is too long for the interface layer
PACKAGES = (  # that decide an asset, and the pages beside it
    "usdfoliage",
    "usd-core",
    "numpy",
    "scipy",
    "opencv-contrib-python-headless",
    "pycolmap",
    "OpenEXR",
    "OpenImageIO",
    "laspy",
    "lazrs",
    "pye57",
    "rawpy",
    "rasterio",
    "jinja2",
)
VALIDATION_PACKAGES = ("usd-validation-nvidia",)  # that decide what is found in an asset, and nothing of it


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """The run that made an asset. Nothing in it names a machine, a folder or a time: the same run, the same bytes.

    Attributes:
        species: As the user named it.
        capture: The file name of the input, without its folder; empty where nothing was captured.
        generator: Tool and version.
        seed: Of the random choices.
        settings: For the record: option and value.
        input_sha256: Of the input's bytes; of several inputs their combined_sha256.
        inputs: Of several inputs: SHA-256 by path from the capture's folder.
        stages: Of several runs: the settings of each.
        versions: Of the packages that took part (package_versions).

    Raises:
        ValueError: capture or an input is no such path.
    """

    species: str = ""
    capture: str
    generator: str
    seed: int
    settings: Mapping[str, str] = field(default_factory=dict)
    input_sha256: str
    inputs: Mapping[str, str] = field(default_factory=dict)
    stages: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.capture and Path(self.capture).name != self.capture:
            raise ValueError(f"capture is a file name without folders, not {self.capture}")
        for name in self.inputs:
            if not name or "\\" in name or PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
                raise ValueError(f"an input is named by its path from the capture's folder, not {name!r}")


def combined_sha256(inputs: Mapping[str, str]) -> str:
    """One digest of many files: of the lines "<sha256>  <name>" in the order of the names, as sha256sum writes them."""
    lines = "".join(f"{digest}  {name}\n" for name, digest in sorted(inputs.items()))
    return digest_text(lines)


def package_versions(names: Sequence[str] = PACKAGES) -> dict[str, str]:
    """The versions of those of the packages that are installed."""
    found = {}
    for name in names:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def author_provenance(layer: Sdf.Layer, provenance: Provenance) -> None:
    """Record the run in the layer's customLayerData; of its inputs only their number: PROVENANCE_FILE has the rest."""
    custom = dict(layer.customLayerData)
    record: dict[str, Any] = {
        "capture": provenance.capture,
        "generator": provenance.generator,
        "inputSha256": provenance.input_sha256,
        "seed": provenance.seed,
        "settings": {str(key): str(value) for key, value in sorted(provenance.settings.items())},
    }
    if provenance.versions:
        record["versions"] = {str(key): str(value) for key, value in sorted(provenance.versions.items())}
    if provenance.inputs:
        record["inputCount"] = len(provenance.inputs)
    if needs_file(provenance):
        record["provenance"] = PROVENANCE_FILE
    custom[CUSTOM_DATA_KEY] = record
    layer.customLayerData = custom


def needs_file(provenance: Provenance) -> bool:
    """Whether the record has more than author_provenance writes."""
    return bool(provenance.inputs or provenance.stages)


def write_provenance_file(folder: Path, provenance: Provenance) -> Path:
    """Write all that is known of the run to PROVENANCE_FILE of the asset in folder; the same run, the same bytes.

    Raises:
        WriteError: It cannot be written.
    """
    content = {
        "species": provenance.species,
        "capture": provenance.capture,
        "generator": provenance.generator,
        "seed": provenance.seed,
        "settings": dict(provenance.settings),
        "stages": {name: dict(settings) for name, settings in provenance.stages.items()},
        "versions": dict(provenance.versions),
        "inputSha256": provenance.input_sha256,
        "inputs": dict(provenance.inputs),
    }
    path = folder / PROVENANCE_FILE
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(content, indent=2, sort_keys=True, ensure_ascii=False) + "\n", encoding="utf-8")
    except OSError as error:
        raise describe_unwritten(path, error) from error
    return path


def read_provenance_file(folder: Path) -> tuple[dict[str, str], dict[str, dict[str, str]]]:
    """Inputs and stages in PROVENANCE_FILE of the asset in folder; none where there is no such file, or another."""
    try:
        content = read_json(folder / PROVENANCE_FILE)
    except (OSError, ValueError):
        return {}, {}
    if not isinstance(content, dict):
        return {}, {}
    return texts(content.get("inputs")), {
        str(name): texts(settings)
        for name, settings in (content.get("stages") or {}).items()
        if isinstance(settings, dict)
    }


def texts(record: object) -> dict[str, str]:
    """A dictionary of texts, empty for what is no dictionary."""
    return {str(key): str(value) for key, value in record.items()} if isinstance(record, dict) else {}
