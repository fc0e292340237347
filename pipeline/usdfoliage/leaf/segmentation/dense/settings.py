"""Everything that decides how the method dense finds leaves."""

from dataclasses import dataclass, field

from usdfoliage.leaf.segmentation.dense.claims import (
    ClaimSettings,
    PointSettings,
)
from usdfoliage.leaf.segmentation.dense.coherence import CoherenceSettings
from usdfoliage.leaf.segmentation.dense.evidence import EvidenceSettings
from usdfoliage.leaf.segmentation.dense.parts import PartSettings
from usdfoliage.leaf.segmentation.dense.patches import (
    PatchSettings,
)
from usdfoliage.leaf.segmentation.dense.rims import RimSettings


@dataclass(frozen=True, kw_only=True)
class PassSettings:
    """When a pass keeps a leaf."""

    min_quality: float  # 0 to 1
    violation_weight: float  # of the share of a leaf that views look through
    max_overlap: float  # share of a leaf that better ones may cover

    def __post_init__(self) -> None:
        if not (0 <= self.min_quality <= 1 and self.violation_weight >= 0 and 0 < self.max_overlap <= 1):
            raise ValueError(f"min_quality and max_overlap must be from 0 to 1, violation_weight 0 or more: {self}")


@dataclass(frozen=True, kw_only=True)
class DenseSegmentationSettings:
    """How leaves are found. Distances are in pixel footprints, noises of the depth and usual leaf lengths."""

    plane_threshold_m: float | None = None  # between a leaf and its points; auto: from noise and footprints
    coherence: CoherenceSettings = field(default_factory=CoherenceSettings)
    rims: RimSettings = field(default_factory=RimSettings)
    patches: PatchSettings = field(default_factory=PatchSettings)
    parts: PartSettings = field(default_factory=PartSettings)
    evidence: EvidenceSettings = field(default_factory=EvidenceSettings)
    claims: ClaimSettings = field(default_factory=ClaimSettings)
    points: PointSettings = field(default_factory=PointSettings)
    # First fits are rough: what sees through them counts less, and many are tried.
    first: PassSettings = field(
        default_factory=lambda: PassSettings(min_quality=0.06, violation_weight=0.4, max_overlap=0.6)
    )
    second: PassSettings = field(
        default_factory=lambda: PassSettings(min_quality=0.08, violation_weight=0.4, max_overlap=0.5)
    )
    third: PassSettings = field(
        default_factory=lambda: PassSettings(min_quality=0.1, violation_weight=0.5, max_overlap=0.5)
    )
    last: PassSettings = field(
        default_factory=lambda: PassSettings(min_quality=0.12, violation_weight=0.7, max_overlap=0.35)
    )
    piece_length: float = 0.3  # least length of a patch that may be a leaf, in usual lengths
    piece_area: float = 0.04  # and its least area, in squares of it
    whole: float = 2.5  # most of both
    crease_deg: float = 20.0  # turn of the surface at which a patch may be two leaves
    part: float = 0.8  # most of a patch that a part of it is
    hopeless: float = 0.5  # of the quality that a pass asks for, below which a patch is not tried again
    joined_quality: float = 0.5  # of the worse of two pieces, that both as one leaf need
    reach: float = 0.15  # usual lengths that a leaf claims of the surface beyond its model
    min_confidence: float = 0.12  # of a leaf that is given to the fit
    shared: float = 0.2  # share of a leaf that better ones may cover in the end
    twins: float = 0.1  # leaf lengths between leaves that are the same
    large_px: float = 100.0  # of the usual leaf's length, from which rims are filled and patches parted at necks
    misfit: float = 0.06  # usual lengths that the surface of a leaf may be off its model
    tolerance: float = 0.65  # of the misfit, within which a point lies on a leaf
    longer: float = 1.33  # factor by which the usual leaf may turn out longer than the pass before had it
    shorter: float = 1.1  # and shorter: pieces pass for leaves more often than two leaves for one
    slender: float = 0.3  # least width of the usual leaf, in its lengths: what is narrower is a stem, or grass

    def __post_init__(self) -> None:
        if self.plane_threshold_m is not None and not self.plane_threshold_m > 0:
            raise ValueError(f"plane_threshold_m must be above 0, not {self.plane_threshold_m}")
        for name in (
            "piece_length",
            "piece_area",
            "whole",
            "crease_deg",
            "part",
            "twins",
            "shared",
            "tolerance",
            "large_px",
        ):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be above 0, not {getattr(self, name)}")
        for name in ("hopeless", "joined_quality", "reach", "min_confidence", "misfit", "slender"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name} must not be below 0, but is {getattr(self, name)}")
        if not min(self.longer, self.shorter) >= 1:
            raise ValueError(f"longer and shorter must be at least 1, not {self.longer} and {self.shorter}")
