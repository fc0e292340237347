"""The variant sets of an asset: declared on the interface, filled in the payload."""

from collections.abc import Mapping, Sequence

from pxr import Sdf, Usd

# What each variant of each set refers to, as paths from the payload's folder; the first variant is the default.
# A set appears when the asset has something to choose, `lod` always: shots select it by name.
VariantLayers = Mapping[str, Mapping[str, Sequence[str]]]


def author_variant_sets(stage: Usd.Stage, path: Sdf.Path, variants: VariantLayers) -> None:
    """Declare the sets and select each one's default, so that both can be seen and changed while nothing is loaded."""
    prim = stage.GetPrimAtPath(path)
    for set_name, members in variants.items():
        variant_set = prim.GetVariantSets().AddVariantSet(set_name)
        for member in members:
            variant_set.AddVariant(member)
        variant_set.SetVariantSelection(next(iter(members)))


def author_variant_references(stage: Usd.Stage, path: Sdf.Path, variants: VariantLayers) -> None:
    """Fill the same sets with references; the selection stays to the interface, and to who refers to it."""
    prim = stage.GetPrimAtPath(path)
    for set_name, members in variants.items():
        variant_set = prim.GetVariantSets().AddVariantSet(set_name)
        for member, layers in members.items():
            variant_set.AddVariant(member)
            variant_set.SetVariantSelection(member)
            with variant_set.GetVariantEditContext():
                for layer in layers:
                    prim.GetReferences().AddReference(layer)
        variant_set.ClearVariantSelection()
