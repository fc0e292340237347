"""How places on stems are joined to one skeleton."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class JoinSettings:
    """How places on stems are joined. Lengths are shares of the plant's height."""

    longest_gap: float = 0.15  # Places up to this far apart are linked. Range: above 0.
    gap: float = 0.025  # Across a gap of this length a link costs twice as much. Range: above 0.
    bend: float = 3.0  # A link straight across the course of both its stems costs so much more. Range: 0 or more.
    fork: float = 1.0  # A link straight across the course of one of them, likewise. Range: 0 or more.
    fall: float = 3.0  # A link that leads straight down costs so much more. Range: 0 or more.
    # A stem that is hidden down to the soil costs, for each gap that it is long, so much more. Range: 0 or more.
    hidden: float = 0.5
    sure: float = 0.3  # Each unit of the logarithm of the odds makes a link cheaper by e to this. Range: 0 or more.
    low: float = 0.15  # A place on a stem up to this height goes on to the soil. Range: 0 to 1.
    highest_root: float = 0.5  # A stem that is seen from up to this height on goes on to the soil. Range: 0 to 1.
    stem: float = 0.4  # A stem that springs from the soil reaches at least this height. Range: 0 to 1.
    root: float = 0.04  # What speaks against a root: a stem of this length of even odds. Range: 0 or more.
    base: float = 0.2  # What speaks for the base of a leaf, likewise. Range: 0 or more.
    missing: float = 0.3  # What speaks against a gap, for its length. Range: 0 or more.
    twig: float = 0.02  # A branch is at least this long. Range: 0 or more.
    # A stem is seen where photographs show at least this length of it unbroken. Range: 0 or more.
    unbroken: float = 0.05
    # Photographs must show stems of at least this length together, or there are none. Range: 0 or more.
    min_visible: float = 0.3
    stiffness: float = 4.0  # Of axes, against the distance that places are moved. Range: 0 or more.
    # The logarithm of the odds that a leaf's base is the end to which the way from the soil costs less is this multiple
    # of the logarithm of how much less. Range: 0 or more.
    end: float = 5.0

    def __post_init__(self) -> None:
        if not (self.longest_gap > 0 and self.gap > 0):
            raise ValueError(f"longest_gap and gap must be above 0, not {self.longest_gap:g} and {self.gap:g}")
        for name in ("low", "highest_root", "stem"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must be from 0 to 1, not {getattr(self, name):g}")
        for name in (
            "bend",
            "fork",
            "fall",
            "hidden",
            "sure",
            "root",
            "base",
            "missing",
            "twig",
            "unbroken",
            "min_visible",
            "stiffness",
            "end",
        ):
            if not 0 <= getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be 0 or more, not {getattr(self, name):g}")
