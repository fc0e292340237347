"""Weights of quadratic forms: learned from examples, and formatted as the product reads them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from usdfoliage.geometry.quadratic_form import QuadraticForm

OF_A_SCAN = 3000.0  # weight of all that one scan holds together
RIDGE = 3.0
ITERATIONS = 40

Array = NDArray[np.float64]


def learn_form(facts: Sequence[Array], worth: Sequence[Array], shares: Sequence[Array] | None = None) -> QuadraticForm:
    """The quadratic form that gives the worth of what scans hold best; every scan counts the same.

    Args:
        facts: Of each scan (R, K).
        worth: Of each scan (R,), from 0 to 1.
        shares: Of each scan (R,), how much each of its rows counts; all the same without it.
    """
    everything = np.concatenate(facts)
    sought = np.concatenate(worth)
    shares = shares or [np.ones(len(each)) for each in facts]
    weight = np.concatenate([OF_A_SCAN * each / max(float(each.sum()), 1e-12) for each in shares])
    middle, spread = np.average(everything, axis=0, weights=weight), everything.std(axis=0) + 1e-9
    scaled = (everything - middle) / spread
    low = np.tril_indices(scaled.shape[1])
    design = np.column_stack([np.ones(len(scaled)), scaled, scaled[:, low[0]] * scaled[:, low[1]]])
    solution = np.zeros(design.shape[1])
    for _ in range(ITERATIONS):  # Newton's steps to the most likely weights
        likely = 1 / (1 + np.exp(-np.clip(design @ solution, -30, 30)))
        curvature = (design * (weight * likely * (1 - likely) + 1e-9)[:, None]).T @ design
        curvature += RIDGE * np.eye(len(solution))
        solution += np.linalg.solve(curvature, design.T @ (weight * (sought - likely)) - RIDGE * solution)
    count = scaled.shape[1]
    square = np.zeros((count, count))
    square[low] = solution[1 + count :]
    return QuadraticForm(
        middle=middle, spread=spread, offset=float(solution[0]), linear=solution[1 : 1 + count], square=square
    )


def format_form(name: str, form: QuadraticForm) -> str:
    """A table of weights.toml."""

    def numbers(values: Array) -> str:
        return "[" + ", ".join(f"{value:.4g}" for value in values.tolist()) + "]"

    rows = "\n".join(f"  {numbers(row[: number + 1])}," for number, row in enumerate(form.square))
    return (
        f"[{name}]\noffset = {form.offset:.4g}\nmiddle = {numbers(form.middle)}\nspread = {numbers(form.spread)}\n"
        f"linear = {numbers(form.linear)}\nsquare = [\n{rows}\n]\n"
    )
