"""How long a sway may be; it loads nothing, so that a command's help appears at once."""

MAX_FRAMES = 10_000


def check_sway_frames(frames: int) -> None:
    """Raises ValueError for a loop of fewer frames than 2, or of more than MAX_FRAMES."""
    if not 2 <= frames <= MAX_FRAMES:
        raise ValueError(f"frames of a sway must be 2 to {MAX_FRAMES}, not {frames}")
