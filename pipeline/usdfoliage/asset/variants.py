"""The variant sets of an asset: declared on the interface, filled in the payload."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
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
    for held in sets:
        variant_set = prim.GetVariantSets().AddVariantSet(held.name)
        for member in held.variants:
            variant_set.AddVariant(member)
        variant_set.SetVariantSelection(next(iter(held.variants)))


def author_variant_references(stage: Usd.Stage, path: Sdf.Path, sets: Sequence[VariantSet]) -> None:
    """Fill the same sets with references; the selection stays to the interface, and to who refers to it.

    A set inside variants of one before it is filled within each of them, so that where they are not selected none of
    its layers is opened. Of the sets inside the same variant the first is strongest.
    """
    # Specs, not the stage's prims: to author in a variant these must select it, and with that open all its layers.
    prim = stage.GetEditTarget().GetLayer().GetPrimAtPath(path)
    for number, held in enumerate(sets):
        if not held.inside:
            _fill(prim, prim, held, list(itertools.takewhile(lambda inner: inner.inside, sets[number + 1 :])))


def each_variant(stage: Usd.Stage, path: Sdf.Path, name: str, variants: Sequence[str]) -> Iterator[str]:
    """Go through the variants of a set of the prim at path; what is authored meanwhile lies within each. None is left
    selected: a layer that has a set of the same name again follows the selection of who refers to it.
    """
    variant_set = stage.GetPrimAtPath(path).GetVariantSets().AddVariantSet(name)
    for variant in variants:
        variant_set.AddVariant(variant)
        variant_set.SetVariantSelection(variant)
        with variant_set.GetVariantEditContext():
            yield variant
    variant_set.ClearVariantSelection()


def _fill(
    owner: Sdf.PrimSpec | Sdf.VariantSpec, prim: Sdf.PrimSpec, held: VariantSet, inner: Sequence[VariantSet]
) -> None:
    """Fill a set of owner, the prim or a variant of it; prim is what owner says of the prim."""
    prim.variantSetNameList.prependedItems.append(held.name)
    variant_set = Sdf.VariantSetSpec(owner, held.name)
    for member, layers in held.variants.items():
        variant = Sdf.VariantSpec(variant_set, member)
        for layer in layers:
            variant.primSpec.referenceList.prependedItems.append(Sdf.Reference(layer))
        for nested in inner:
            if member in nested.inside:
                _fill(variant, variant.primSpec, nested, ())
