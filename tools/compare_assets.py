#!/usr/bin/env python
"""Compare the composed values of two assets in every selection of their variants.

usage: tools/compare_assets.py OLD NEW [--tolerance 1e-6] [--show 20]

OLD and NEW are folders of assets, or their interface layers. In every selection of the variant sets all prims are
compared one by one, and of each prim its type, schemas and metadata, the values of its attributes with their time
samples, their connections, the targets of its relationships, and the bytes of the pictures that attributes name. Two
assets of different names are compared as if both had the name of OLD.

What describes the run that made an asset, and not the plant, is ignored: see IGNORED_PROPERTIES, IGNORED_METADATA.
Prints what differs, then one line with counts. Exit code 1 where something differs, 2 where an asset cannot be opened.
"""

import argparse
import hashlib
import itertools
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf, Tf, Usd
from usdfoliage.asset.locate import find_interface
from usdfoliage.errors import FoliageError

IGNORED_PROPERTIES = ("foliage:generator",)  # name and version of the tool
IGNORED_METADATA = ("customLayerData",)  # of the interface layer: digests, settings, versions, where files are listed
# Metadata that compose other prims or variants: what comes of them is compared.
_COMPOSING = ("references", "payload", "inheritPaths", "specializes", "variantSetNames", "variantSelection")
_RESOLVED = re.compile("resolvedPath='[^']*'")  # where a file lies on this machine
_STAGE_METADATA = ("upAxis", "metersPerUnit", "startTimeCode", "endTimeCode", "timeCodesPerSecond", "framesPerSecond")


@dataclass(frozen=True, kw_only=True)
class Difference:
    """One thing that two assets do not have in common."""

    where: str  # prim or property
    what: str


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """What was compared, and what differs; the same difference in several selections is one."""

    selections: int
    prims: int
    properties: int
    differences: dict[Difference, str]  # the first selection in which each was found


def compare_assets(old: Path, new: Path, tolerance: float = 0.0) -> Comparison:
    """Compare two assets.

    Args:
        old: Folder or interface layer of the one.
        new: Of the other.
        tolerance: How far two numbers may be apart.

    Raises:
        FoliageError: One of them is no asset.
    """
    layers = [Sdf.Layer.FindOrOpen(str(find_interface(path))) for path in (old, new)]
    for path, layer in zip((old, new), layers, strict=True):
        if layer is None or not layer.defaultPrim:
            raise FoliageError(f"{path} cannot be opened, or has no default prim; name an asset")
    found: dict[Difference, str] = {}
    selections = prims = properties = 0
    sets = [_variants(layer) for layer in layers]
    for name in sorted(sets[0].keys() | sets[1].keys()):
        if sets[0].get(name) != sets[1].get(name):
            found[Difference(where=f"variant set {name}", what=f"{sets[0].get(name)} and {sets[1].get(name)}")] = "any"
    common = {
        name: [each for each in variants.names if each in sets[1][name].names]
        for name, variants in sets[0].items()
        if name in sets[1]
    }
    for chosen in itertools.product(*common.values()):
        selection = dict(zip(common, chosen, strict=True))
        label = ", ".join(f"{name}={variant}" for name, variant in selection.items()) or "no variants"
        stages = [_open(layer, selection) for layer in layers]
        by_path = [_prims(stage) for stage in stages]
        selections += 1
        for difference in _compare_stages(stages[0], stages[1]):
            found.setdefault(difference, label)
        for path in sorted(by_path[0].keys() | by_path[1].keys()):
            pair = by_path[0].get(path), by_path[1].get(path)
            if pair[0] is None or pair[1] is None:
                where = "OLD" if pair[1] is None else "NEW"
                found.setdefault(Difference(where=path, what=f"only in {where}"), label)
                continue
            prims += 1
            properties += len(pair[0].GetPropertyNames())
            for difference in _compare_prims(path, pair[0], pair[1], tolerance):
                found.setdefault(difference, label)
    return Comparison(selections=selections, prims=prims, properties=properties, differences=found)


@dataclass(frozen=True)
class _Variants:
    """The variants of a set, sorted, and the one that is selected."""

    names: tuple[str, ...]
    selected: str


def _variants(layer: Sdf.Layer) -> dict[str, _Variants]:
    """The variants of each set of the default prim."""
    stage = Usd.Stage.Open(layer, Usd.Stage.LoadNone)
    sets = stage.GetDefaultPrim().GetVariantSets()
    variant_sets = {name: sets.GetVariantSet(name) for name in sets.GetNames()}
    return {
        name: _Variants(tuple(sorted(each.GetVariantNames())), each.GetVariantSelection())
        for name, each in variant_sets.items()
    }


def _open(layer: Sdf.Layer, selection: dict[str, str]) -> Usd.Stage:
    session = Sdf.Layer.CreateAnonymous(".usda")
    root = Sdf.CreatePrimInLayer(session, f"/{layer.defaultPrim}")
    for name, variant in selection.items():
        root.variantSelections[name] = variant
    return Usd.Stage.Open(layer, session)


def _prims(stage: Usd.Stage) -> dict[str, Usd.Prim]:
    """By path, in which the name of the root prim is replaced."""
    everything = Usd.PrimRange(stage.GetPseudoRoot(), Usd.PrimAllPrimsPredicate)
    return {_neutral(str(prim.GetPath()), stage): prim for prim in everything if not prim.IsPseudoRoot()}


def _neutral(text: str, stage: Usd.Stage) -> str:
    """A text that does not depend on the name of the root prim."""
    return text.replace(stage.GetDefaultPrim().GetName(), "NAME")


def _compare_stages(old: Usd.Stage, new: Usd.Stage) -> Iterator[Difference]:
    for name in _STAGE_METADATA:
        if old.GetMetadata(name) != new.GetMetadata(name):
            yield Difference(where="stage", what=f"{name}: {old.GetMetadata(name)} and {new.GetMetadata(name)}")


def _compare_prims(path: str, old: Usd.Prim, new: Usd.Prim, tolerance: float) -> Iterator[Difference]:
    facts = [
        {
            "type": str(prim.GetTypeName()),
            "schemas": list(prim.GetAppliedSchemas()),
            "children": [child.GetName() for child in prim.GetAllChildren()],
        }
        for prim in (old, new)
    ]
    for name in facts[0]:
        values = [_neutral(str(fact[name]), prim.GetStage()) for fact, prim in zip(facts, (old, new), strict=True)]
        if values[0] != values[1]:
            yield Difference(where=path, what=f"{name}: {values[0]} and {values[1]}")
    yield from _compare_metadata(path, old, new)
    names = [{str(name) for name in prim.GetPropertyNames()} - set(IGNORED_PROPERTIES) for prim in (old, new)]
    for name in sorted(names[0] ^ names[1]):
        yield Difference(where=f"{path}.{name}", what=f"only in {'OLD' if name in names[0] else 'NEW'}")
    for name in sorted(names[0] & names[1]):
        yield from _compare_properties(f"{path}.{name}", old.GetProperty(name), new.GetProperty(name), tolerance)


def _compare_metadata(where: str, old: Usd.Object, new: Usd.Object) -> Iterator[Difference]:
    metadata = [
        {
            str(name): _neutral(_RESOLVED.sub("", str(value)), thing.GetStage())
            for name, value in thing.GetAllAuthoredMetadata().items()
            if name not in (*IGNORED_METADATA, *_COMPOSING)
        }
        for thing in (old, new)
    ]
    for name in sorted(metadata[0].keys() | metadata[1].keys()):
        if metadata[0].get(name) != metadata[1].get(name):
            yield Difference(where=where, what=f"{name}: {metadata[0].get(name)} and {metadata[1].get(name)}")


def _compare_properties(where: str, old: Usd.Property, new: Usd.Property, tolerance: float) -> Iterator[Difference]:
    yield from _compare_metadata(where, old, new)
    if isinstance(old, Usd.Relationship) or isinstance(new, Usd.Relationship):
        targets = [
            [_neutral(str(target), thing.GetStage()) for target in thing.GetForwardedTargets()]
            if isinstance(thing, Usd.Relationship)
            else None
            for thing in (old, new)
        ]
        if targets[0] != targets[1]:
            yield Difference(where=where, what=f"targets: {targets[0]} and {targets[1]}")
        return
    assert isinstance(old, Usd.Attribute)
    assert isinstance(new, Usd.Attribute)
    connections = [[_neutral(str(path), thing.GetStage()) for path in thing.GetConnections()] for thing in (old, new)]
    if connections[0] != connections[1]:
        yield Difference(where=where, what=f"connections: {connections[0]} and {connections[1]}")
    times = [thing.GetTimeSamples() for thing in (old, new)]
    if times[0] != times[1]:
        yield Difference(where=where, what=f"times: {times[0]} and {times[1]}")
        return
    for time in (Usd.TimeCode.Default(), *map(Usd.TimeCode, times[0])):
        reason = _compare_values(old.Get(time), new.Get(time), old.GetStage(), new.GetStage(), tolerance)
        if reason:
            at = "" if time.IsDefault() else f" at {time.GetValue():g}"
            yield Difference(where=where, what=f"value{at}: {reason}")


def _compare_values(old: Any, new: Any, old_stage: Usd.Stage, new_stage: Usd.Stage, tolerance: float) -> str:
    """Why two values differ; empty where they do not."""
    if isinstance(old, Sdf.AssetPath) and isinstance(new, Sdf.AssetPath):
        if _neutral(old.path, old_stage) != _neutral(new.path, new_stage):
            return f"{old.path} and {new.path}"
        digests = [_digest(value.resolvedPath) for value in (old, new)]
        return "" if digests[0] == digests[1] else f"the bytes of {old.path} differ"
    if type(old) is not type(new):
        return f"of type {type(old).__name__} and {type(new).__name__}"
    numbers = [_numbers(value) for value in (old, new)]
    if numbers[0] is None or numbers[1] is None:
        texts = _neutral(str(old), old_stage), _neutral(str(new), new_stage)
        return "" if texts[0] == texts[1] else f"{texts[0][:80]} and {texts[1][:80]}"
    if numbers[0].shape != numbers[1].shape:
        return f"{numbers[0].shape} and {numbers[1].shape} numbers"
    with np.errstate(invalid="ignore"):
        away = np.abs(numbers[0] - numbers[1])
    unlike = ~((away <= tolerance) | (numbers[0] == numbers[1]) | (np.isnan(numbers[0]) & np.isnan(numbers[1])))
    if not unlike.any():
        return ""
    return f"{np.count_nonzero(unlike):,} of {unlike.size:,} numbers differ, by {np.nanmax(away[unlike]):.3g} at most"


def _numbers(value: Any) -> np.ndarray | None:
    """The numbers of a value; None for what is none."""
    if value is None or isinstance(value, str | bool):
        return None
    try:
        numbers = np.asarray(value)
    except (TypeError, ValueError):
        return None
    return numbers.astype(np.float64) if numbers.dtype.kind in "iuf" else None


def _digest(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest() if path and Path(path).is_file() else ""


def main() -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--tolerance", type=float, default=0.0, help="how far two numbers may be apart (0)")
    parser.add_argument("--show", type=int, default=20, help="how many differences are printed (20)")
    options = parser.parse_args()
    try:
        compared = compare_assets(options.old, options.new, options.tolerance)
    except (FoliageError, Tf.ErrorException) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    for difference, label in itertools.islice(compared.differences.items(), options.show):
        print(f"{difference.where}: {difference.what} ({label})")
    if len(compared.differences) > options.show:
        print(f"… and {len(compared.differences) - options.show} more")
    print(
        f"{compared.selections} selections, {compared.prims:,} prims, {compared.properties:,} properties compared: "
        f"{len(compared.differences)} differences; ignored: {', '.join((*IGNORED_PROPERTIES, *IGNORED_METADATA))}"
    )
    return 1 if compared.differences else 0


if __name__ == "__main__":
    sys.exit(main())
