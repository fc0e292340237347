"""What a forest holds, read from its layers."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from pxr import Usd, UsdGeom

from usdfoliage.asset.schema import FOREST_API
from usdfoliage.asset.stored_numbers import stored_numbers


@dataclass(frozen=True, kw_only=True)
class ForestInfo:
    """The plants of a forest in the selected level, and its ground."""

    plants: Mapping[str, int]  # by species
    levels: Mapping[str, int]  # plants by instancer
    seed: int
    lod_distance_m: tuple[float, float]
    terrain_faces: int


def read_forest(root: Usd.Prim) -> ForestInfo:
    """What the instancers of a forest and its ground are."""
    plants: dict[str, int] = {}
    levels: dict[str, int] = {}
    seed, distance = 0, (0.0, 0.0)
    faces = 0
    counted = np.zeros(0, np.int64)
    walk = iter(Usd.PrimRange(root))
    for prim in walk:
        if prim.HasAPI(FOREST_API):
            walk.PruneChildren()
            species = [str(name) for name in prim.GetAttribute("foliage:forest:species").Get() or ()]
            indices = stored_numbers(UsdGeom.PointInstancer(prim).GetProtoIndicesAttr().Get(), (None,))
            rows = np.zeros(0, np.int64) if indices is None else indices.astype(np.int64)
            levels[prim.GetName()] = levels.get(prim.GetName(), 0) + len(rows)
            ids = stored_numbers(UsdGeom.PointInstancer(prim).GetIdsAttr().Get(), (None,))
            if ids is not None and len(ids) == len(rows):  # in a shot a plant may stand in several
                new = ~np.isin(ids, counted)
                counted = np.concatenate([counted, ids[new].astype(np.int64)])
                rows = rows[new]
            for row, count in zip(*np.unique(rows, return_counts=True), strict=True):
                name = species[row] if 0 <= row < len(species) else "unknown"
                plants[name] = plants.get(name, 0) + int(count)
            seed = int(prim.GetAttribute("foliage:forest:seed").Get() or 0)
            near, far = prim.GetAttribute("foliage:forest:lodDistance").Get() or (0.0, 0.0)
            distance = float(near), float(far)
        elif prim.IsA(UsdGeom.PointInstancer):
            walk.PruneChildren()  # grass near a camera, whose meshes are no ground
        elif prim.IsA(UsdGeom.Mesh):
            faces += len(UsdGeom.Mesh(prim).GetFaceVertexCountsAttr().Get() or ())
    return ForestInfo(plants=plants, levels=levels, seed=seed, lod_distance_m=distance, terrain_faces=faces)
