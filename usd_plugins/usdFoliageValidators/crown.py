"""Validators of FoliageCrownAPI: the prim's values, and the cubemap files that it names."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Usd

from usdFoliageValidators import values
from usdFoliageValidators.findings import Findings, error, warning, wrong_prim_type

MAPS = {"foliage:crown:radiusMap": ("R",), "foliage:crown:colorMap": ("B", "G", "R")}
RANGE_TOLERANCE = 1e-5  # relative; both are float32


def check_crown(prim: Usd.Prim, _time: object) -> Findings:
    """The crown's centre, range and weight are authored and possible, and both maps are named."""
    findings = wrong_prim_type(prim, "FoliageCrownAPI", ("Mesh",))
    if findings:
        return findings
    for name in MAPS:
        if values.asset_path(prim, name) is None:
            text = "is not authored; name the cubemap file, relative to the layer"
            findings.append(error(prim, "CubemapMissing", text, name))
    center = values.tuple_of(prim, "foliage:crown:center", 3)
    if center is None or not np.isfinite(center).all():
        text = "must be three finite numbers; author the point from which the cubemaps are seen"
        findings.append(error(prim, "CrownCenter", text, "foliage:crown:center"))
    span = values.tuple_of(prim, "foliage:crown:radiusRange", 2)
    if span is None or not (0 < span[0] <= span[1] < np.inf):
        value = "no value" if span is None else f"({span[0]:g}, {span[1]:g})"
        text = f"has {value}; author the smallest and largest radius of the map, in metres, above 0"
        findings.append(error(prim, "RadiusRange", text, "foliage:crown:radiusRange"))
    weight = values.number(prim, "foliage:crown:reliefWeight")
    if values.is_authored(prim, "foliage:crown:reliefWeight") and not (weight is not None and 0 <= weight < 2):
        text = f"is {weight}; author 0 or more and below 2, else the relief reaches the centre"
        findings.append(error(prim, "ReliefWeight", text, "foliage:crown:reliefWeight"))
    leaf_texture = values.asset_path(prim, "foliage:crown:leafTexture")
    if leaf_texture is not None and not leaf_texture.resolvedPath:
        text = f"names {leaf_texture.path}, which is not there; put the file beside the layer or correct the path"
        findings.append(error(prim, "LeafTextureMissing", text, "foliage:crown:leafTexture"))
    return findings


def check_crown_files(prim: Usd.Prim, _time: object) -> Findings:
    """The cubemap files exist, are cubemaps by their header, shape and shared borders, and agree with the prim."""
    findings: Findings = []
    for name, channels in MAPS.items():
        asset = values.asset_path(prim, name)
        if asset is None:
            continue
        if not asset.resolvedPath:
            text = f"names {asset.path}, which is not there; put the file beside the layer or correct the path"
            findings.append(error(prim, "CubemapNotFound", text, name))
            continue
        path = Path(asset.resolvedPath)
        if not path.is_file():
            text = f"is {asset.resolvedPath}, not a plain file, so its pixels were not checked; check it as files"
            findings.append(warning(prim, "CubemapNotChecked", text, name))
            continue
        status = path.stat()
        try:
            file = _read(path, status.st_mtime_ns, status.st_size)
        except ImportError as missing:
            text = (
                f"was not checked: this Python has no module {missing.name}; install OpenEXR and put usdfoliage on "
                "PYTHONPATH to check cubemaps"
            )
            findings.append(warning(prim, "CubemapNotChecked", text, name))
            continue
        except (OSError, RuntimeError, ValueError) as fault:
            text = f"names {asset.path}, which cannot be read as OpenEXR ({fault}); write it again"
            findings.append(error(prim, "CubemapUnreadable", text, name))
            continue
        findings += [error(prim, fault, f"names {asset.path}, which {text}", name) for fault, text in file.faults]
        if file.pixels is not None:
            findings += _check_pixels(prim, name, asset.path, channels, file)
    return findings


@dataclass(frozen=True, kw_only=True, eq=False)
class _Cubemap:
    """What a file holds, and what is wrong with it as a cubemap."""

    channels: tuple[str, ...]
    pixels: NDArray[np.float32] | None  # (6, N, N, channel), none where it is no cubemap
    shared_apart: int  # border texels that differ from the neighbouring face's
    faults: tuple[tuple[str, str], ...]  # (name, text)


@lru_cache(maxsize=8)  # the same files are asked for in every variant selection
def _read(path: Path, _modified_ns: int, _size: int) -> _Cubemap:
    import OpenEXR  # a studio's usdchecker may run where it is missing
    from usdfoliage.geometry.cubemap import texel_identity

    with OpenEXR.File(str(path), separate_channels=True) as file:
        header, stored = dict(file.header()), file.channels()  # the module empties its own when the file is closed
        channels = {name: np.array(channel.pixels, dtype=np.float32) for name, channel in sorted(stored.items())}
    faults = []
    if header.get("envmap") != OpenEXR.ENVMAP_CUBE:
        faults.append(("CubemapHeader", "has no envmap = ENVMAP_CUBE in its header; write it as a cubemap"))
    shapes = {channel.shape for channel in channels.values()}
    height, width = next(iter(shapes)) if len(shapes) == 1 else (0, 0)
    if width < 2 or height != 6 * width:
        text = f"is {width} x {height} pixels; write it as N x 6N, its faces from top to bottom, N 2 or more"
        faults.append(("CubemapShape", text))
        return _Cubemap(channels=tuple(channels), pixels=None, shared_apart=0, faults=tuple(faults))
    pixels = np.stack(list(channels.values()), axis=-1).reshape(6, width, width, len(channels))
    _, first, inverse = np.unique(texel_identity(width), return_index=True, return_inverse=True)
    flat = pixels.reshape(-1, len(channels))
    apart = np.any((flat != flat[first[inverse.ravel()]]) & np.isfinite(flat), axis=1)
    return _Cubemap(
        channels=tuple(channels), pixels=pixels, shared_apart=int(np.count_nonzero(apart)), faults=tuple(faults)
    )


def _check_pixels(prim: Usd.Prim, name: str, path: str, channels: tuple[str, ...], file: _Cubemap) -> Findings:
    assert file.pixels is not None
    if file.channels != channels:
        text = f"names {path}, whose channels are {', '.join(file.channels)}; write {', '.join(channels)} alone"
        return [error(prim, "CubemapChannels", text, name)]
    findings: Findings = []
    beyond = int(np.count_nonzero(~np.isfinite(file.pixels)))
    if beyond:
        text = f"names {path}, in which {beyond} values are not finite; write it again"
        return [error(prim, "CubemapNotFinite", text, name)]
    if file.shared_apart:
        text = (
            f"names {path}, in which {file.shared_apart} border texels differ from those they share with the "
            "neighbouring face, which shows as a seam; make them equal"
        )
        findings.append(error(prim, "CubemapBorders", text, name))
    smallest, largest = float(file.pixels.min()), float(file.pixels.max())
    if name == "foliage:crown:colorMap":
        if smallest < 0:
            text = f"names {path}, whose smallest colour is {smallest:g}; write it again with colours of 0 or more"
            findings.append(error(prim, "ColorNegative", text, name))
        return findings
    if smallest <= 0:
        text = f"names {path}, whose smallest radius is {smallest:g} m; write it again with every radius above 0"
        findings.append(error(prim, "RadiusNotPositive", text, name))
    span = values.tuple_of(prim, "foliage:crown:radiusRange", 2)
    if span is not None and not np.allclose(span, (smallest, largest), rtol=RANGE_TOLERANCE, atol=0):
        text = f"is ({span[0]:g}, {span[1]:g}), but {path} goes from {smallest:g} to {largest:g} m; author these"
        findings.append(error(prim, "RadiusRangeOfFile", text, "foliage:crown:radiusRange"))
    return findings
