"""Everything that decides how the method dense finds leaves."""

from dataclasses import dataclass, field

from usdfoliage.leaf.photographs.outline_edges import OutlineSettings
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

    min_quality: float  # A leaf of lower quality is dropped in this pass. Range: 0 to 1.
    # The quality of a leaf falls with the share of it that photographs see through, times this weight. Range: 0 or
    # more.
    violation_weight: float
    max_overlap: float  # Better leaves cover at most this share of a leaf. Range: above 0, up to 1.

    def __post_init__(self) -> None:
        if not (0 <= self.min_quality <= 1 and self.violation_weight >= 0 and 0 < self.max_overlap <= 1):
            raise ValueError(f"min_quality and max_overlap must be from 0 to 1, violation_weight 0 or more: {self}")


@dataclass(frozen=True, kw_only=True)
class DenseSegmentationSettings:
    """How leaves are found. Distances are in pixel footprints, noises of the depth and median leaf lengths."""

    # A point lies on a leaf up to this distance; auto derives it from noise and footprints. Unit: metres. Range:
    # above 0.
    plane_threshold_m: float | None = None
    coherence: CoherenceSettings = field(default_factory=CoherenceSettings)
    rims: RimSettings = field(default_factory=RimSettings)
    patches: PatchSettings = field(default_factory=PatchSettings)
    parts: PartSettings = field(default_factory=PartSettings)
    evidence: EvidenceSettings = field(default_factory=EvidenceSettings)
    outlines: OutlineSettings = field(default_factory=OutlineSettings)
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
    # A patch that may be a leaf is at least this long. Unit: median leaf lengths. Range: above 0.
    piece_length: float = 0.15
    # A patch that may be a leaf has at least this area. Unit: squared median leaf lengths. Range: above 0.
    piece_area: float = 0.01
    # A patch that may be a leaf has at most this length and this area. Unit: median leaf lengths, and squares of
    # them. Range: above 0.
    whole: float = 2.5
    # A patch may be two leaves where its surface turns by this angle. Unit: degrees. Range: above 0.
    crease_deg: float = 20.0
    part: float = 0.8  # A part of a patch is tried as a leaf of its own up to this share of the patch. Range: above 0.
    # A patch whose leaf reaches less than this share of the quality that a pass requires is not tried again. Range: 0
    # or more.
    hopeless: float = 0.5
    # Two pieces count as one leaf where the joined leaf reaches this share of the quality of the worse piece. Range:
    # 0 or more.
    joined_quality: float = 0.5
    # A leaf claims the surface beyond its model up to this distance. Unit: median leaf lengths. Range: 0 or more.
    reach: float = 0.15
    # A region of the depth maps is fitted as a leaf if it is one with more than this probability. Range: 0 to 1.
    min_confidence: float = 0.6
    shared: float = 0.2  # Better leaves cover at most this share of a leaf in the end. Range: above 0.
    # Leaves that are nearer to each other than this are the same leaf. Unit: leaf lengths. Range: above 0.
    twins: float = 0.1
    # Rims are filled, and patches parted at necks, where the median leaf is at least this long in the photographs.
    # Unit: pixels. Range: above 0.
    large_px: float = 100.0
    # The surface of a real leaf lies off its model by up to this much. Unit: median leaf lengths. Range: 0 or more.
    misfit: float = 0.06
    tolerance: float = 0.65  # A point lies on a leaf within this share of the misfit. Range: above 0.
    # The median leaf becomes longer from one pass to the next by this factor at most. Range: 1 or more.
    longer: float = 1.33
    # The median leaf becomes shorter by this factor at most. Pieces pass for leaves more often than two leaves for
    # one. Range: 1 or more.
    shorter: float = 1.1
    # The median leaf is at least this wide. What is narrower is a stem or grass. Unit: median leaf lengths. Range: 0
    # or more.
    slender: float = 0.3

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
        if not 0 <= self.min_confidence <= 1:
            raise ValueError(f"min_confidence must be from 0 to 1, not {self.min_confidence}")
        for name in ("hopeless", "joined_quality", "reach", "misfit", "slender"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name} must not be below 0, but is {getattr(self, name)}")
        if not min(self.longer, self.shorter) >= 1:
            raise ValueError(f"longer and shorter must be at least 1, not {self.longer} and {self.shorter}")
