"""Validator of FoliageForestAPI: the species table, the instances' jitter, the orthophoto."""

import numpy as np
from pxr import Usd, UsdGeom

from usdFoliageValidators import values
from usdFoliageValidators.findings import Findings, count, error, wrong_prim_type

KINDS = ("tree", "shrub", "grass")
SHARE_TOLERANCE = 1e-3


def check_forest(prim: Usd.Prim, _time: object) -> Findings:
    """The species table has a row a prototype; every number is in its range; the orthophoto is there."""
    findings = wrong_prim_type(prim, "FoliageForestAPI", ("PointInstancer",))
    if findings:
        return findings
    return _check_species(prim) + _check_instances(prim) + _check_orthophoto(prim)


def _check_species(prim: Usd.Prim) -> Findings:
    findings: Findings = []
    prototypes = len(UsdGeom.PointInstancer(prim).GetPrototypesRel().GetForwardedTargets())
    species = values.texts(prim, "foliage:forest:species") or []
    kinds = np.array(values.texts(prim, "foliage:forest:speciesKind") or [])
    shares = values.numbers(prim, "foliage:forest:speciesShare")
    shares = np.zeros(0) if shares is None else shares
    scales = values.numbers(prim, "foliage:forest:speciesScale", 2)
    scales = np.zeros((0, 2)) if scales is None else scales
    columns = {"species": species, "speciesKind": kinds, "speciesShare": shares, "speciesScale": scales}
    for name, column in columns.items():
        if len(column) != prototypes:
            text = f"has {len(column)} rows; author {prototypes}, one for each of prototypes"
            findings.append(error(prim, "SpeciesTableLength", text, f"foliage:forest:{name}"))
    if findings:
        return findings
    if not all(name.strip() for name in species):
        findings.append(error(prim, "SpeciesName", "has an empty name; name every species", "foliage:forest:species"))
    wrong = ~np.isin(kinds, KINDS)
    if wrong.any():
        text = f"is none of {', '.join(KINDS)} in {count(wrong, 'rows')}; use one of these"
        findings.append(error(prim, "SpeciesKind", text, "foliage:forest:speciesKind"))
    wrong = ~((shares >= 0) & (shares <= 1))
    if wrong.any():
        text = f"is not 0 to 1 in {count(wrong, 'rows')}; author shares"
        findings.append(error(prim, "SpeciesShare", text, "foliage:forest:speciesShare"))
    else:
        for kind in np.unique(kinds):
            total = float(shares[kinds == kind].sum())
            if abs(total - 1) > SHARE_TOLERANCE:
                text = f"sums to {total:g} for {kind}; author shares that sum to 1 for each kind"
                findings.append(error(prim, "SpeciesShare", text, "foliage:forest:speciesShare"))
    wrong = ~((scales[:, 0] > 0) & (scales[:, 0] <= scales[:, 1]) & np.isfinite(scales).all(axis=1))
    if wrong.any():
        text = f"is no range above 0 in {count(wrong, 'rows')}; author (least, greatest)"
        findings.append(error(prim, "SpeciesScale", text, "foliage:forest:speciesScale"))
    return findings


def _check_instances(prim: Usd.Prim) -> Findings:
    findings: Findings = []
    seed = values.number(prim, "foliage:forest:seed")
    if seed is None or seed < 0:
        text = f"is {seed}; author the seed, 0 or more, so that the forest can be made again"
        findings.append(error(prim, "ForestSeed", text, "foliage:forest:seed"))
    if values.is_authored(prim, "foliage:forest:lodJitter"):
        positions = values.numbers(prim, "positions", 3)
        instances = 0 if positions is None else len(positions)
        jitter = values.numbers(prim, "foliage:forest:lodJitter")
        if jitter is None or len(jitter) != instances:
            length = 0 if jitter is None else len(jitter)
            text = f"has {length} elements; author {instances}, one for each of positions"
            findings.append(error(prim, "LodJitterLength", text, "foliage:forest:lodJitter"))
        else:
            wrong = ~((jitter >= 0) & (jitter <= 1))
            if wrong.any():
                text = f"is not 0 to 1 in {count(wrong, 'instances')}; draw it again"
                findings.append(error(prim, "LodJitterRange", text, "foliage:forest:lodJitter"))
        distance = values.tuple_of(prim, "foliage:forest:lodDistance", 2)
        if distance is None or not 0 <= distance[0] <= distance[1] < np.inf:
            text = "must be two distances in metres, 0 or more, the first not above the second, where there is a jitter"
            findings.append(error(prim, "LodDistance", text, "foliage:forest:lodDistance"))
    return findings


def _check_orthophoto(prim: Usd.Prim) -> Findings:
    photo = values.asset_path(prim, "foliage:forest:orthophoto")
    if photo is None:
        return []
    findings: Findings = []
    if not photo.resolvedPath:
        text = f"names {photo.path}, which is not there; put the file beside the layer or correct the path"
        findings.append(error(prim, "OrthophotoMissing", text, "foliage:forest:orthophoto"))
    bounds = values.tuple_of(prim, "foliage:forest:orthophotoBounds", 4)
    if bounds is None or not np.isfinite(bounds).all() or not (bounds[:2] < bounds[2:]).all():
        text = "must be (least x, least z, greatest x, greatest z) in metres, where there is an orthophoto"
        findings.append(error(prim, "OrthophotoBounds", text, "foliage:forest:orthophotoBounds"))
    return findings
