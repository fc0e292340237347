"""Where an asset comes from: what is written of it into the asset."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from pxr import Sdf

from usdfoliage.asset.look_layer import CUSTOM_DATA_KEY


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """The run that made an asset. Nothing in it names a machine, a folder or a time: the same run, the same bytes."""

    species: str = ""  # as the user named it
    capture: str  # file name of the input, without its folder
    generator: str  # tool and version
    seed: int
    settings: Mapping[str, str] = field(default_factory=dict)  # for the record: option and value
    input_sha256: str  # of the input's bytes

    def __post_init__(self) -> None:
        if "/" in self.capture or "\\" in self.capture:
            raise ValueError(f"capture is a file name without folders, not {self.capture}")


def author_provenance(layer: Sdf.Layer, provenance: Provenance) -> None:
    """Record the run in the layer's customLayerData."""
    custom = dict(layer.customLayerData)
    custom[CUSTOM_DATA_KEY] = {
        "capture": provenance.capture,
        "generator": provenance.generator,
        "inputSha256": provenance.input_sha256,
        "seed": provenance.seed,
        "settings": {str(key): str(value) for key, value in sorted(provenance.settings.items())},
    }
    layer.customLayerData = custom
