"""Validator of FoliagePlantAPI: what made the plant, where it came from, which prims carry its parts."""

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd

from usdFoliageValidators import values
from usdFoliageValidators.findings import Findings, error, wrong_prim_type

PARTS = {
    "foliage:leaves": ("FoliageLeafAPI", "FoliageLobedLeafAPI"),
    "foliage:skeleton": ("FoliageSkeletonAPI",),
    "foliage:crown": ("FoliageCrownAPI",),
}
MAX_SELECTIONS = 64


def check_plant(prim: Usd.Prim, _time: object) -> Findings:
    """The generator is named, the way back to the capture is invertible, the relationships lead to the right prims."""
    findings = wrong_prim_type(prim, "FoliagePlantAPI", ("Xform",))
    if findings:
        return findings
    generator = values.value(prim, "foliage:generator")
    if not isinstance(generator, str) or not generator.strip():
        text = "is empty; author the tool and version that wrote the asset"
        findings.append(error(prim, "GeneratorMissing", text, "foliage:generator"))
    matrix = values.numbers_of_shape(values.value(prim, "foliage:captureToAsset"), (4, 4))
    if matrix is None:
        text = "is not authored; author the matrix from the capture's coordinates to the asset's"
        findings.append(error(prim, "CaptureToAsset", text, "foliage:captureToAsset"))
    elif not np.isfinite(matrix).all():
        findings.append(error(prim, "CaptureToAsset", "is not finite; measure it again", "foliage:captureToAsset"))
    elif not _is_invertible(matrix):
        text = "cannot be inverted, so nothing can be laid over the capture; measure it again"
        findings.append(error(prim, "CaptureToAsset", text, "foliage:captureToAsset"))
    for name, schemas in PARTS.items():
        findings += _check_part(prim, name, schemas)
    return findings


def _is_invertible(matrix: NDArray[np.float64]) -> bool:
    """Whether the 3 x 3 part keeps its rank: the ratio of scales, not the determinant, which depends on the unit."""
    scales = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    return bool(matrix[3, 3] != 0 and scales[0] > 0 and scales[2] > 1e-9 * scales[0])


def _check_part(prim: Usd.Prim, name: str, schemas: tuple[str, ...]) -> Findings:
    relationship = prim.GetRelationship(name)
    targets = relationship.GetForwardedTargets() if relationship else []
    findings: Findings = []
    if len(targets) > 1:
        text = f"has {len(targets)} targets; leave one"
        findings.append(error(prim, "RelationshipTargets", text, name))
    for target in targets:
        if not target.HasPrefix(prim.GetPath()):
            text = f"targets <{target}>, outside the plant, which is lost where the asset is referenced; target inside"
            findings.append(error(prim, "RelationshipOutside", text, name))
            continue
        if not prim.IsLoaded():
            continue  # the part is behind the payload
        exists = False
        for applied in _applied_in_variants(prim, target):
            exists = True
            if set(schemas) & set(applied):
                break
        else:
            if exists:
                text = f"targets <{target}>, which has no {' or '.join(schemas)}; target the prim that has it"
                findings.append(error(prim, "RelationshipTargetKind", text, name))
            else:
                text = f"targets <{target}>, which exists in no variant; correct the path or drop the target"
                findings.append(error(prim, "RelationshipTargetMissing", text, name))
    return findings


def _applied_in_variants(prim: Usd.Prim, target: Sdf.Path) -> Iterator[list[str]]:
    """The schemas of a prim below the plant as it is, then in every variant selection that has it.

    Leaves are a mesh at the same path where the representation mesh is selected, and no prim in the lod crown.
    """
    part = prim.GetStage().GetPrimAtPath(target)
    if part:
        yield list(part.GetPrimTypeInfo().GetAppliedAPISchemas())
    sets = prim.GetVariantSets()
    names = sets.GetNames()
    selections = itertools.product(*(sets.GetVariantSet(name).GetVariantNames() for name in names))
    for selection in itertools.islice(selections, MAX_SELECTIONS if names else 0):
        session = Sdf.Layer.CreateAnonymous(".usda")
        for path in prim.GetPath().GetPrefixes():  # what is in an instance cannot select for itself
            Sdf.CreatePrimInLayer(session, path).instanceable = False
        spec = session.GetPrimAtPath(prim.GetPath())
        for name, variant in zip(names, selection, strict=True):
            spec.variantSelections[name] = variant
        mask = Usd.StagePopulationMask([target])
        other = Usd.Stage.OpenMasked(prim.GetStage().GetRootLayer(), session, mask)
        part = other.GetPrimAtPath(target)
        if part:
            yield list(part.GetPrimTypeInfo().GetAppliedAPISchemas())
