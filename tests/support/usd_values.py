"""The values of an asset: the composed ones as text to compare with tests/golden, its bytes as hashes."""

import hashlib
import os
import re
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd

NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.])")


def composed(stage: Usd.Stage) -> list[str]:
    """Every prim and property of a stage as lines of text, in the order of their paths."""
    lines = []
    for prim in sorted(stage.TraverseAll(), key=lambda prim: prim.GetPath()):
        schemas = " ".join(prim.GetAppliedSchemas())
        lines.append(f"{prim.GetPath()} {prim.GetSpecifier()} {prim.GetTypeName() or '-'} [{schemas}]")
        for prop in sorted(prim.GetAuthoredProperties(), key=lambda prop: prop.GetName()):
            head = f"{prop.GetPath()}"
            if isinstance(prop, Usd.Relationship):
                lines.append(f"{head} rel {[str(path) for path in prop.GetForwardedTargets()]}")
                continue
            value = prop.Get()
            if isinstance(value, Sdf.AssetPath):
                value = value.path
            connections = [str(path) for path in prop.GetConnections()]
            lines.append(
                f"{head} {prop.GetVariability()} {prop.GetTypeName()} {prop.GetMetadata('interpolation') or ''}"
                f" = {connections if connections else value}"
            )
    return lines


def compare_with_golden(lines: list[str], golden: Path) -> None:
    """The same text, and the same numbers but for the last digits; USDFOLIAGE_UPDATE_GOLDEN writes the file anew."""
    if os.environ.get("USDFOLIAGE_UPDATE_GOLDEN"):
        golden.parent.mkdir(parents=True, exist_ok=True)
        golden.write_text("\n".join(lines) + "\n", encoding="utf-8")
    wanted = golden.read_text(encoding="utf-8").splitlines()
    assert [line.split(" ")[0] for line in lines] == [line.split(" ")[0] for line in wanted]
    for found, line in zip(lines, wanted, strict=True):
        assert NUMBER.sub("#", found) == NUMBER.sub("#", line)
        np.testing.assert_allclose(
            [float(n) for n in NUMBER.findall(found)],
            [float(n) for n in NUMBER.findall(line)],
            rtol=1e-5,
            atol=1e-6,
            err_msg=line[:200],
        )


def compare_text_with_golden(lines: list[str], golden: Path) -> None:
    """The same lines; USDFOLIAGE_UPDATE_GOLDEN writes the file anew."""
    if os.environ.get("USDFOLIAGE_UPDATE_GOLDEN"):
        golden.write_text("\n".join(lines) + "\n", encoding="utf-8")
    assert lines == golden.read_text(encoding="utf-8").splitlines()


def hashes(folder: Path) -> list[tuple[str, str]]:
    """Every file below a folder with the hash of its bytes."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return [(str(path.relative_to(folder)), hashlib.sha256(path.read_bytes()).hexdigest()) for path in files]
