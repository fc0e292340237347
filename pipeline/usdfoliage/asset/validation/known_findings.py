"""Findings on the parts that several selections of an asset's variants share, so that validators check them once.

Two parts are shared. Some rules look at files alone, and those are the same in every selection. Some rules look at
nothing but the properties of one prim, and a prim that is composed of the same specs has the same properties.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from pxr import Usd, UsdGeom

from usdfoliage.asset.validation.findings import Finding

PrimKey = tuple[object, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownFindings:
    """Of one asset, while none of its layers changes."""

    of_files: dict[str, tuple[Finding, ...]] = field(default_factory=dict)  # by validator
    of_prims: dict[tuple[str, PrimKey], tuple[Finding, ...]] = field(default_factory=dict)  # by validator and prim


def key_prims(prims: Iterable[Usd.Prim]) -> Iterator[tuple[Usd.Prim, PrimKey]]:
    """Each prim with what is equal only where its properties and their values are.

    That is its path, the specs that hold opinions of it, strongest first, and how they are moved in time. The session
    layer of a selection is another one each time and counts by the variants that it selects. Whether a prim is a guide,
    which may be authored on a prim above it, counts too: validators of leaves ask for it.
    """
    for prim in prims:
        session = prim.GetStage().GetSessionLayer()
        is_guide = UsdGeom.Imageable(prim).ComputePurpose() == UsdGeom.Tokens.guide
        key: list[object] = [str(prim.GetPath()), is_guide]
        for spec, offset in prim.GetPrimStackWithLayerOffsets():
            if spec.layer == session:
                key.append(tuple(sorted(dict(spec.variantSelections).items())))
            elif not spec.isInert:
                key.append((spec.layer.identifier, str(spec.path), offset.offset, offset.scale))
        yield prim, tuple(key)
