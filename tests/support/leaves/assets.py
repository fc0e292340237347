"""Small sets of leaves with exact numbers, and assets of them."""

import numpy as np
from usdfoliage.asset.packages.leaf_package import write_leaf_asset
from usdfoliage.asset.parts.leaf_part import LeafAppearance, LeafAssetSettings
from usdfoliage.asset.provenance import Provenance
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.jitter import spread_phases
from usdfoliage.leaf.shape.mesh import PrototypeSettings

PROVENANCE = Provenance(
    species="Quercus robur",
    capture="oak 01.jpg",
    generator="usdfoliage 0.0.0",
    seed=7,
    settings={"count": "2"},
    input_sha256="00" * 32,
)
FLAT = np.array(
    [
        [0, 1 / 3, 0],
        [0, 2 / 3, 0],
        [0.25, 0.25, 0],
        [0.5, 0.5, 0],
        [0.75, 0.25, 0],
        [0, 0, 0],
        [0, 0, 0],
    ]
)


def two_leaves() -> Leaves:
    """One flat leaf at the origin, 1 m long, and one of 0.5 m, curled, a quarter turn about x, at (0, 1, 0)."""
    curled = FLAT.copy()
    curled[5:] = (0.125, 0.125, 0.125), (0.0625, 0.0625, 0.0625)
    return Leaves(
        parameters=np.stack([FLAT, curled]),
        base_m=np.array([[0.0, 0, 0], [0, 1, 0]]),
        orientation=np.array([[0, 0, 0, 1], [0.5**0.5, 0, 0, 0.5**0.5]]),
        length_m=np.array([1.0, 0.5]),
        phase=np.array([0.0, 8.0]),
        confidence=np.array([1.0, 0.5]),
        residual_m=np.array([0.0, 0.25]),
        view=np.array([3, -1], np.int32),
    )


def random_leaves(count: int, seed: int = 0, facts: bool = False) -> Leaves:
    """Leaves of any shape near FLAT, size and direction, within some metres of the origin; float32 numbers."""
    rng = np.random.default_rng(seed)
    turns = rng.normal(size=(count, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    numbers = {
        "parameters": FLAT + rng.normal(0, 0.03, (count, 7, 3)),
        "base_m": rng.uniform(-5, 5, (count, 3)),
        "orientation": turns,
        "length_m": rng.uniform(0.01, 0.3, count),
        "phase": spread_phases(count),
    }
    if facts:
        numbers["confidence"] = rng.uniform(0, 1, count)
        numbers["residual_m"] = rng.uniform(0, 0.01, count)
    rounded = {name: array.astype(np.float32).astype(np.float64) for name, array in numbers.items()}
    return Leaves(**rounded, view=rng.integers(-1, 20, count).astype(np.int32) if facts else None)


def write_spray(folder, leaves=None, appearance=LeafAppearance(), edits=None, **settings):
    """The asset "spray" in folder, with few vertices; returns its interface layer."""
    folder.mkdir(parents=True, exist_ok=True)
    settings.setdefault("prototype", PrototypeSettings(across=4, along=2, silhouette=4))
    return write_leaf_asset(
        folder,
        "spray",
        two_leaves() if leaves is None else leaves,
        PROVENANCE,
        LeafAssetSettings(**settings),
        appearance=appearance,
        **({} if edits is None else {"edits": edits}),
    )
