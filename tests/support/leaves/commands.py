"""What the tests of the leaf commands share."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from usdfoliage.__main__ import main
from usdfoliage.asset.locate import find_leaves, select_representation
from usdfoliage.asset.looks.look import open_asset
from usdfoliage.asset.parts.leaves import ReadLeaves, read_leaves


def run(*words: object) -> int:
    return main([str(word) for word in words])


def files(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def refused(capsys, *words: object) -> str:
    """The one line of an error of exit 2."""
    capsys.readouterr()
    assert run(*words) == 2
    streams = capsys.readouterr()
    assert streams.out == ""
    lines = streams.err.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("error: ")
    return lines[0]


def printed(capsys, *words: object) -> list[str]:
    """What a command that succeeds prints, line by line."""
    capsys.readouterr()
    assert run(*words) == 0
    return capsys.readouterr().out.splitlines()


def read(asset: Path) -> ReadLeaves:
    """The leaves of an asset, a look or a scene of one plant."""
    stage = open_asset(asset)
    (prim,) = find_leaves(stage)
    return read_leaves(prim)


def attribute(asset: Path, representation: str, name: str) -> NDArray[np.generic]:
    """An attribute of the prim of the leaves."""
    stage = open_asset(asset)
    select_representation(stage, representation)
    return np.array(stage.GetDefaultPrim().GetPrimAtPath("geo/render/Leaves").GetAttribute(name).Get())


def patch_count(asset: Path, representation: str = "nurbs") -> int:
    """How many prims stand below that of the leaves."""
    stage = open_asset(asset)
    select_representation(stage, representation)
    return len(stage.GetDefaultPrim().GetPrimAtPath("geo/render/Leaves").GetChildren())
