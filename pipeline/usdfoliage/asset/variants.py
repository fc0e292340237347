"""The variant sets of an asset: declared on the interface, filled in the payload."""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from pxr import Sdf, Usd


@dataclass(frozen=True, kw_only=True)
class VariantSet:
    """One thing to choose: `lod`, which every asset has since shots select it by name, or `representation`."""

    name: str
    variants: Mapping[str, Sequence[str]]  # each one's layers, as paths from the payload's folder; the first is default
    inside: Sequence[str] = ()  # variants in which it lies, of the last set before it that has none such


def author_variant_sets(stage: Usd.Stage, path: Sdf.Path, sets: Sequence[VariantSet]) -> None:
    """Declare the sets and select each one's default, so that both can be seen and changed while nothing is loaded."""
    prim = stage.GetPrimAtPath(path)
    for entry in sets:
        variant_set = prim.GetVariantSets().AddVariantSet(entry.name)
        for member in entry.variants:
            variant_set.AddVariant(member)
        variant_set.SetVariantSelection(next(iter(entry.variants)))


def author_variant_references(stage: Usd.Stage, path: Sdf.Path, sets: Sequence[VariantSet]) -> None:
    """Fill the same sets with references; the selection stays to the interface, and to who refers to it.

    A set inside variants of one before it is filled within each of them, so that where they are not selected none of
    its layers is opened. Of the sets inside the same variant the first is strongest.
    """
    # Specs, not the stage's prims: to author in a variant these must select it, and with that open all its layers.
    prim = stage.GetEditTarget().GetLayer().GetPrimAtPath(path)
    for number, entry in enumerate(sets):
        if not entry.inside:
            _fill(prim, prim, entry, list(itertools.takewhile(lambda inner: inner.inside, sets[number + 1 :])))


def _fill(
    owner: Sdf.PrimSpec | Sdf.VariantSpec, prim: Sdf.PrimSpec, entry: VariantSet, inner: Sequence[VariantSet]
) -> None:
    """Fill a set of owner, the prim or a variant of it; prim is the spec of the prim within owner."""
    prim.variantSetNameList.prependedItems.append(entry.name)
    variant_set = Sdf.VariantSetSpec(owner, entry.name)
    for member, layers in entry.variants.items():
        variant = Sdf.VariantSpec(variant_set, member)
        for layer in layers:
            variant.primSpec.referenceList.prependedItems.append(Sdf.Reference(layer))
        for nested in inner:
            if member in nested.inside:
                _fill(variant, variant.primSpec, nested, ())


REPRESENTATIONS: Mapping[str, str] = {  # and the layer of each, in the payload's folder
    "bezier": "leaves.usdc",
    "nurbs": "leaves_nurbs.usdc",
    "subdiv": "leaves_subdiv.usdc",
    "mesh": "leaves_mesh.usdc",
}


def order_variants(names: Iterable[str]) -> list[str]:
    """Names of variants in the order of REPRESENTATIONS where they are there, others after them by name."""
    order = {name: number for number, name in enumerate(REPRESENTATIONS)}
    return sorted(names, key=lambda name: (order.get(name, len(order)), name))


def check_representations(names: Sequence[str]) -> None:
    """Raises ValueError for no representation, one that there is not, or one that is named twice."""
    unknown = [name for name in names if name not in REPRESENTATIONS]
    if unknown or not names or len(set(names)) < len(names):
        raise ValueError(
            f"representations must be one or more of {', '.join(REPRESENTATIONS)}, each once, "
            f"not {', '.join(names) or 'none'}"
        )
