"""Settings of a build that are options of its commands too; they load little, so that a help appears at once."""

from dataclasses import dataclass

from usdfoliage.asset.variants import check_representations
from usdfoliage.branch.motion.sway_frames import MAX_FRAMES
from usdfoliage.capture.folder.hold_back import check_hold_back


@dataclass(frozen=True, kw_only=True)
class SeedSettings:
    """Where random choice begins."""

    seed: int = 0  # Every random choice of every stage starts from this number. Range: 0 to 2147483647.

    def __post_init__(self) -> None:
        if not 0 <= self.seed < 2**31:
            raise ValueError(f"seed must be 0 or more and below 2^31, not {self.seed}")


@dataclass(frozen=True, kw_only=True)
class PlantSettings:
    """The plant, and how its asset is written."""

    # The species is written into the asset. A known one, such as maple, also sets allometry, twigs and leaves.
    species: str = ""
    # The asset has its leaves in these forms: a list of bezier, nurbs, subdiv and mesh. auto chooses by the number of
    # leaves.
    representations: tuple[str, ...] | None = None
    # Every N-th photograph from the third on is withheld: nothing is made of it, and the report measures the asset by
    # it. This is N; 0 holds no photograph back. Range: 0, or 2 or more.
    hold_back: int = 0
    # The branches get joints, and a gentle sway that is a loop of this many frames; leaves follow. The variant rig=skel
    # shows it. 0 leaves both out. Range: 0, or 2 to 10000.
    sway_frames: int = 0
    # true writes the sway as value clips, which a shot can loop, shift and stretch; false writes time samples.
    sway_clips: bool = False
    # The growth of the plant is written in this many frames. The variant growth=growing shows it. 0 leaves it out.
    # Range: 0, or 2 to 10000.
    growth_frames: int = 0
    version: str = "1"  # The version of the asset is written into its assetInfo.

    def __post_init__(self) -> None:
        check_hold_back(self.hold_back)
        if self.sway_frames and not 2 <= self.sway_frames <= MAX_FRAMES:
            raise ValueError(f"sway_frames must be 0, or 2 to {MAX_FRAMES}, not {self.sway_frames}")
        if self.growth_frames and not 2 <= self.growth_frames <= MAX_FRAMES:
            raise ValueError(f"growth_frames must be 0, or 2 to {MAX_FRAMES}, not {self.growth_frames}")
        if self.representations is not None:
            check_representations(self.representations)
