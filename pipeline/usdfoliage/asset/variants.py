"""The variant sets of an asset: declared on the interface, filled in the payload."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pxr import Sdf, Usd


@dataclass(frozen=True, kw_only=True)
class VariantSet:
    """One thing to choose: `lod`, which every asset has since shots select it by name, or `representation`."""

    name: str
    variants: Mapping[str, Sequence[str]]  # each one's layers, as paths from the payload's folder; the first is default
    inside: Sequence[str] = ()  # variants of the set before it in which this one lies; everywhere without any


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

    A set inside variants of the one before it is filled within each of them, so that where they are not selected none
    of its layers is opened.
    """
    prim = stage.GetPrimAtPath(path)
    for number, held in enumerate(sets):
        if not held.inside:
            _fill(prim, held, [inner for inner in sets[number + 1 : number + 2] if inner.inside])


def _fill(prim: Usd.Prim, held: VariantSet, inner: Sequence[VariantSet]) -> None:
    variant_set = prim.GetVariantSets().AddVariantSet(held.name)
    for member, layers in held.variants.items():
        variant_set.AddVariant(member)
        variant_set.SetVariantSelection(member)
        with variant_set.GetVariantEditContext():
            for layer in layers:
                prim.GetReferences().AddReference(layer)
            for nested in inner:
                if member in nested.inside:
                    _fill(prim, nested, ())
    variant_set.ClearVariantSelection()
