"""What is taken of a video."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class VideoSettings:
    """Which frames of a video are taken as photographs."""

    # A frame is taken of each stretch in which what is seen moves by this share of the picture's longer side.
    # Range: 0.005 to 0.5.
    min_motion: float = 0.05
    max_frames: int = 100  # At most this many frames are taken: of a longer video, longer stretches. Range: 2 to 2000.
    # At most this many frames a second are looked at; the sharpest one of a stretch is found among them. Unit: Hz.
    # Range: 1 to 240.
    max_rate_hz: float = 12.0
    max_minutes: float = 30.0  # Longer videos are refused. Unit: minutes. Range: above 0 to 600.

    def __post_init__(self) -> None:
        if not 0.005 <= self.min_motion <= 0.5:
            raise ValueError(f"min_motion must be 0.005 to 0.5, not {self.min_motion:g}")
        if not 2 <= self.max_frames <= 2000:
            raise ValueError(f"max_frames must be 2 to 2000, not {self.max_frames}")
        if not 1 <= self.max_rate_hz <= 240:
            raise ValueError(f"max_rate_hz must be 1 to 240, not {self.max_rate_hz:g}")
        if not 0 < self.max_minutes <= 600:
            raise ValueError(f"max_minutes must be above 0 and at most 600, not {self.max_minutes:g}")
