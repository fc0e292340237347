"""What is more probable by several facts at once: a quadratic form of learned weights."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from usdfoliage.files.toml import parse_toml


@dataclass(frozen=True, kw_only=True, eq=False)
class QuadraticForm:
    """The logarithm of the odds of K facts x: offset + linear z + z square z, with z = (x - middle) / spread."""

    middle: NDArray[np.float64]  # (K,)
    spread: NDArray[np.float64]  # (K,)
    offset: float
    linear: NDArray[np.float64]  # (K,)
    square: NDArray[np.float64]  # (K, K)

    def odds(self, facts: NDArray[np.float64]) -> NDArray[np.float64]:
        """(R,), their logarithm, of facts (R, K)."""
        scaled = (facts - self.middle) / self.spread
        return np.asarray(self.offset + scaled @ self.linear + np.einsum("ri,ri->r", scaled @ self.square, scaled))

    def probability(self, facts: NDArray[np.float64]) -> NDArray[np.float64]:
        """(R,), 0 to 1, of facts (R, K)."""
        return np.asarray(expit(self.odds(facts)))


def parse_form(text: str, name: str) -> QuadraticForm:
    """The form of this name in a file that tools/learned_forms.py formats: tables of TOML, the squares' lower half."""
    table = parse_toml(text)[name]
    rows = table["square"]
    square = np.zeros((len(rows), len(rows)))
    for number, row in enumerate(rows):
        square[number, : number + 1] = row
    return QuadraticForm(
        middle=np.array(table["middle"]),
        spread=np.array(table["spread"]),
        offset=float(table["offset"]),
        linear=np.array(table["linear"]),
        square=square,
    )
