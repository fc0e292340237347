"""The worst files that a command may be given: large ones, counts beyond all memory, prims in prims without end.

A scale makes what is large smaller; the counts that a file only states stay.
"""

import re
import shutil
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from tools.fuzz.crates import ARRAY_LENGTH, COUNT, SECTIONS, state_array_counts, state_section_count

PRIMS = 1_000_000
TEXT_BYTES = 1 << 30
CLASSES = 20_000
PARENTHESES = 100_000
DOUBLINGS = 30  # each prim has the one before it twice
PICTURE_PX = 30_000  # a side
_BLOCK_PRIMS = 400  # of a text that is written in blocks
_SMALL = ("--size", "32", "--mesh-size", "17", "--no-preview")
_QUICK = ("--settings", "bed/fast.toml", "--no-report")
_BUILD = ("build", "bed", "-o", "out/bed", "--work", "work", "--only", "matching")

Make = Callable[[Path, float], None]  # in a folder that has the seeds, at a scale


@dataclass(frozen=True, kw_only=True)
class WorstFile:
    """A file that is as bad as it can be, and the commands that read it."""

    name: str
    target: str  # the file, below the folder of the commands
    make: Make
    commands: Sequence[Sequence[str]]
    trees: Sequence[str] = ()  # of the seeds, that its folder has


def worst_files() -> list[WorstFile]:
    """All of them, the quick ones first."""
    return [*_cloud_files(), *_picture_files(), *_stored_files(), *_crates(), *_layers()]


def _usd_commands(asset: str) -> tuple[tuple[str, ...], ...]:
    return (
        ("info", asset),
        ("validate", asset),
        ("edit", asset, "--width", "2", "-o", "out.usda"),
        ("bake", asset, "-o", "out"),
        ("preview", asset, "-o", "out.png", "--size", "64", "64"),
        ("branches", "cloud/tree.ply", "--leaves", asset, "--no-preview", "-o", "out"),
    )


# ---- clouds


def _cloud_files() -> Iterator[WorstFile]:
    def commands(name: str) -> tuple[tuple[str, ...], ...]:
        return (
            ("branches", name, "--no-preview", "-o", "out"),
            ("crown", name, *_SMALL, "-o", "out"),
            ("leaves", name, "--up", "Y", "--unit", "m", "--no-preview", "-o", "out"),
            ("build", name, "-o", "out/plant", "--work", "work"),
        )

    def captured(name: str) -> tuple[tuple[str, ...], ...]:
        return (
            ("leaves", name, "--no-preview", "-o", "out"),
            ("capture", name, *_QUICK, "-o", "out"),
            ("branches", name, "--no-preview", "-o", "out"),
            ("build", name, "-o", "out/plant", "--work", "work", "--only", "branches"),
        )

    for order, words in (("binary_little_endian", "PLY"), ("binary_big_endian", "PLY, big"), ("ascii", "PLY, text")):
        make = partial(_write_ply, name="a.ply", order=order)
        yield WorstFile(name=f"{words}, 2^31 points", target="a.ply", make=make, commands=commands("a.ply"))
    make = partial(_write_ply, name="a.ply", order="binary_little_endian", lists=True)
    yield WorstFile(name="PLY, a list of 2^31", target="a.ply", make=make, commands=commands("a.ply"))
    make = partial(_write_ply, name="a.ply", order="binary_little_endian", with_holes=True)
    yield WorstFile(name="PLY, 2^31 points in holes", target="a.ply", make=make, commands=commands("a.ply"))
    las = "cloud/tree.las"
    yield WorstFile(name="LAS, 2^31 points", target=las, make=_write_las, commands=commands(las), trees=("cloud",))
    make = partial(_write_ply, name="bed/cloud.ply", order="binary_little_endian")
    yield WorstFile(
        name="PLY of a capture, 2^31", target="bed/cloud.ply", make=make, commands=captured("bed"), trees=("bed",)
    )


def _write_ply(
    folder: Path, scale: float, name: str, order: str, lists: bool = False, with_holes: bool = False
) -> None:
    count = int(COUNT * scale) if with_holes else COUNT
    properties = "property list uint float w\n" if lists else ""
    properties += "property float x\nproperty float y\nproperty float z\n"
    header = f"ply\nformat {order} 1.0\nelement vertex {50 if lists else count}\n{properties}end_header\n"
    data = b"1 2 3\n" * 50 if order == "ascii" else struct.pack("<I", COUNT) * lists + bytes(600)
    with (folder / name).open("wb") as file:
        file.write(header.encode() + data)
        if with_holes:
            file.truncate(len(header) + 12 * count)


def _write_las(folder: Path, _scale: float) -> None:
    path = folder / "cloud" / "tree.las"
    data = bytearray(path.read_bytes())
    struct.pack_into("<I", data, 107, COUNT)
    struct.pack_into("<Q", data, 247, COUNT)
    path.write_bytes(data)


# ---- pictures


def _picture_files() -> Iterator[WorstFile]:
    def photograph(name: str) -> tuple[tuple[str, ...], ...]:
        return (
            ("crown", name, *_SMALL, "-o", "out"),
            ("crown", name, "--mask", "photo/mask.png", "-o", "out", "--dry-run"),
            ("scatter", "-n", "2", "--texture", name, "-o", "out"),
            ("edit", "plants/spray", "--jitter", "0.1", "2", "--jitter-map", name, "-o", "out.usda"),
        )

    beds = (
        ("leaves", "bed", "--no-preview", "-o", "out"),
        ("capture", "bed", *_QUICK, "-o", "out"),
        ("crown", "bed", *_SMALL, "-o", "out"),
        ("branches", "bed", "--no-preview", "-o", "out"),
        ("build", "bed", "-o", "out/plant", "--work", "work", "--only", "leaves"),
    )
    for name, target, commands, trees in (
        ("EXR, a window of 2^31", "photo/oak.exr", photograph("photo/oak.exr"), ("photo", "plants")),
        ("EXR of depth, 2^31", "bed/depth/leaf 3.exr", beds, ("bed",)),
        ("EXR of a crown, 2^31", "plants/crown/maps/crown_crown_radius.exr", _asset_commands(), ("plants", "cloud")),
    ):
        yield WorstFile(
            name=name, target=target, make=partial(_widen_exr, target=target), commands=commands, trees=trees
        )
    make = partial(_write_large_png, target="photo/large.png")
    yield WorstFile(
        name="PNG, 30,000 by 30,000", target="photo/large.png", make=make, commands=photograph("photo/large.png"),
        trees=("photo", "plants"),
    )  # fmt: skip
    target = "bed/images/leaf 1.png"
    yield WorstFile(
        name="PNG of a capture, 30,000", target=target, make=partial(_write_large_png, target=target), commands=beds,
        trees=("bed",),
    )  # fmt: skip


def _asset_commands() -> tuple[tuple[str, ...], ...]:
    """Of a crown, which has no leaves."""
    return tuple(each for each in _usd_commands("plants/crown") if each[0] in ("info", "validate", "preview"))


def _widen_exr(folder: Path, _scale: float, target: str) -> None:
    """Windows from 0 to the largest number that they may have."""
    path = folder / target
    data = bytearray(path.read_bytes())
    for match in re.finditer(rb"(?:dataWindow|displayWindow)\0box2i\0", bytes(data)):
        struct.pack_into("<4i", data, match.end() + 4, 0, 0, COUNT - 1, COUNT - 1)
    path.write_bytes(data)


def _write_large_png(folder: Path, scale: float, target: str) -> None:
    """A picture of 8 bits and three channels, black, which is small on the disk."""
    side = max(16, int(PICTURE_PX * scale**0.5))
    packer = zlib.compressobj(1)
    row = bytes(1 + 3 * side)
    packed = b"".join([*(packer.compress(row) for _ in range(side)), packer.flush()])
    chunks = ((b"IHDR", struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)), (b"IDAT", packed), (b"IEND", b""))
    (folder / target).write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + b"".join(
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
            for kind, data in chunks
        )
    )


# ---- what an earlier run left


def _stored_files() -> Iterator[WorstFile]:
    yield WorstFile(
        name="NPZ of a work folder, 2^31", target="work", make=_write_npz, commands=(_BUILD, ("work", "work")),
        trees=("bed", "work"),
    )  # fmt: skip


def _write_npz(folder: Path, _scale: float) -> None:
    """Each array of the pictures that a build has prepared states 2^31 numbers in a row."""
    stored = sorted((folder / "work").rglob("*.npz"))
    if not stored:
        raise ValueError("the work folder has no .npz file")
    for path in stored:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
        with zipfile.ZipFile(path, "w") as archive:
            for name in names:
                with archive.open(name, "w") as file:
                    np.lib.format.write_array_header_1_0(
                        file, {"descr": "<f8", "fortran_order": False, "shape": (COUNT,)}
                    )
                    file.write(bytes(800))


# ---- crates


def _crates() -> Iterator[WorstFile]:
    def commands(asset: str) -> tuple[tuple[str, ...], ...]:
        return _usd_commands(asset)

    yield WorstFile(
        name="crate, arrays of 2^31", target="a.usdc", make=_write_array_crate, commands=commands("a.usdc"),
        trees=("cloud",),
    )  # fmt: skip
    target = "plants/spray/payload/leaves.usdc"
    for section, numbers in SECTIONS.items():
        for number, what in enumerate(numbers):
            yield WorstFile(
                name=f"crate, {section} {what}",
                target=target,
                make=partial(_write_section_crate, target=target, section=section, number=number),
                commands=commands("plants/spray"),
                trees=("cloud", "plants"),
            )
    yield WorstFile(
        name="plant, 2^31 in its numbers", target="plants/spray", make=_write_large_numbers,
        commands=(*commands("plants/spray"), ("bake", "plants/spray", "--representation", "nurbs", "-o", "out")),
        trees=("cloud", "plants"),
    )  # fmt: skip


def _write_array_crate(folder: Path, _scale: float) -> None:
    from pxr import Sdf

    layer = Sdf.Layer.CreateAnonymous(".usdc")
    rng = np.random.default_rng(0)
    text = ", ".join(map(str, rng.integers(0, 2**31, ARRAY_LENGTH)))
    points = ", ".join(f"({x:.4f}, {y:.4f}, 0.5)" for x, y in rng.random((ARRAY_LENGTH, 2)))
    names = ", ".join(f'"t{number}"' for number in range(ARRAY_LENGTH))
    layer.ImportFromString(
        f"""#usda 1.0
(
    defaultPrim = "a"
)
def PointInstancer "a" {{
    int64[] ids = [{text}]
    point3f[] positions = [{points}]
    int[] protoIndices = [{text}]
    token[] names = [{names}]
    rel prototypes = </a/b>
    def Sphere "b" {{}}
}}
"""
    )
    layer.Export(str(folder / "a.usdc"))
    (folder / "a.usdc").write_bytes(state_array_counts((folder / "a.usdc").read_bytes()))


def _write_section_crate(folder: Path, _scale: float, target: str, section: str, number: int) -> None:
    path = folder / target
    path.write_bytes(state_section_count(path.read_bytes(), section, number))


def _write_large_numbers(folder: Path, _scale: float) -> None:
    """Every whole number of a plant is the largest one, and what its leaves pack states as many leaves."""
    from pxr import Sdf, Vt

    large = {"int": COUNT - 1, "int64": 2**63 - 1}
    for path in (folder / "plants" / "spray" / "payload").glob("*.usd*"):
        layer = Sdf.Layer.FindOrOpen(str(path))
        found: list[Sdf.Path] = []
        layer.Traverse(Sdf.Path.absoluteRootPath, found.append)
        for each in found:
            spec = layer.GetAttributeAtPath(each)
            if spec is None or spec.default is None:
                continue
            kind = str(spec.typeName)
            if kind in large:
                spec.default = large[kind]
            elif kind.removesuffix("[]") in large:
                made = Vt.IntArray if kind == "int[]" else Vt.Int64Array
                spec.default = made([large[kind.removesuffix("[]")]] * len(spec.default))
            elif each.name == "primvars:leaf:packed":
                spec.default = Vt.FloatArray([float(COUNT), *list(spec.default)[1:]])
            elif each.name == "primvars:leaf:edit:jitterFrequency":
                spec.default = float(COUNT)
        layer.Save()


# ---- layers of text


def _layers() -> Iterator[WorstFile]:
    usda = _usd_commands("a.usda")
    for name, text in (
        ("usda, a list of 2^31", _list_of_large_numbers),
        ("usda, 20,000 classes", _write_classes),
        ("usda, 100,000 parentheses", _write_parentheses),
        ("usda, 2^30 prims by inheriting", _write_doublings),
        ("usda, a million prims", _write_prims),
        ("usda, 1 GB of text", _write_text),
    ):
        make = partial(_write_layer, name="a.usda", write=text)
        yield WorstFile(name=name, target="a.usda", make=make, commands=usda, trees=("cloud",))
    make = partial(_write_layer, name="a.usda", write=_write_prims, crate=True)
    yield WorstFile(
        name="usdc, a million prims", target="a.usdc", make=make, commands=_usd_commands("a.usdc"), trees=("cloud",)
    )
    make = partial(_write_layer, name="a.usda", write=_write_text, packed=True)
    yield WorstFile(
        name="usdz, 1 GB of text", target="a.usdz", make=make, commands=_usd_commands("a.usdz"), trees=("cloud",)
    )
    for name, added in (
        ("plant, 20,000 classes", _write_classes),
        ("plant, 2^30 prims by inheriting", _write_doublings),
        ("plant, a million prims", _write_prims),
        ("plant, 1 GB of text", _write_text),
    ):
        yield WorstFile(
            name=name,
            target="plants/spray",
            make=partial(_add_to_plant, write=added),
            commands=_usd_commands("plants/spray"),
            trees=("cloud", "plants"),
        )


_PLANT = b"""#usda 1.0
(
    defaultPrim = "a"
)
def Xform "a" (prepend apiSchemas = ["FoliagePlantAPI"]) {
"""
Write = Callable[[float, bytes], Iterator[bytes]]  # the prims below a path, at a scale


def _write_layer(
    folder: Path, scale: float, name: str, write: Write, crate: bool = False, packed: bool = False
) -> None:
    """A layer with these prims below its default prim, a plant."""
    path = folder / name
    with path.open("wb") as file:
        file.write(
            b'#usda 1.0\n(\n    defaultPrim = "a"\n)\ndef Xform "a" (prepend apiSchemas = ["FoliagePlantAPI"]) {\n'
        )
        file.writelines(write(scale, b"/a"))
        file.write(b"}\n")
    if crate:
        from pxr import Sdf

        Sdf.Layer.FindOrOpen(str(path)).Export(str(path.with_suffix(".usdc")))
    if packed:
        _pack(path)
    if crate or packed:
        path.unlink()


def _pack(path: Path) -> None:
    """A package of one layer, at a multiple of 64 bytes as USD asks for."""
    padding = 64 - (30 + len(path.name) + 4) % 64
    info = zipfile.ZipInfo(path.name)
    info.extra = struct.pack("<HH", 0x1986, padding) + bytes(padding)
    info.file_size = path.stat().st_size
    with (
        zipfile.ZipFile(path.with_suffix(".usdz"), "w") as archive,
        path.open("rb") as read,
        archive.open(info, "w") as written,
    ):
        shutil.copyfileobj(read, written, 1 << 20)


def _add_to_plant(folder: Path, scale: float, write: Write) -> None:
    """An asset whose payload has these prims too, below its root prim."""
    path = folder / "plants" / "spray" / "payload" / "payload.usda"
    text = path.read_bytes()
    at = text.rindex(b"}")
    with path.open("wb") as file:
        file.write(text[:at])
        file.write(b'def Scope "a" {\n')
        file.writelines(write(scale, b"/spray/a"))
        file.write(b"}\n" + text[at:])


def _write_prims(scale: float, _at: bytes) -> Iterator[bytes]:
    for start in range(0, max(1, int(PRIMS * scale)), 1000):
        count = min(1000, int(PRIMS * scale) - start)
        yield b"".join(b'def Xform "p%d" {}\n' % number for number in range(start, start + count))


def _write_text(scale: float, _at: bytes) -> Iterator[bytes]:
    """Prims with numbers, as many as fill the size."""
    block = b"".join(
        b'over "p$$$$$$$$_%d" {\n    double a = 0.123456789012\n    double b = -1234567.25\n}\n' % number
        for number in range(_BLOCK_PRIMS)
    )
    for number in range(-(-int(TEXT_BYTES * scale) // len(block))):
        yield block.replace(b"$$$$$$$$", b"%08d" % number)


def _write_classes(scale: float, at: bytes) -> Iterator[bytes]:
    count = max(1, int(CLASSES * scale))
    yield b"".join(b'class "c%d" (inherits = <%b/c%d>) {}\n' % (number, at, number + 1) for number in range(count))
    yield b'class "c%d" {}\ndef Xform "last" (inherits = <%b/c0>) {}\n' % (count, at)


def _write_parentheses(scale: float, _at: bytes) -> Iterator[bytes]:
    count = max(1, int(PARENTHESES * scale))
    yield b"custom int x = " + b"(" * count + b")" * count + b"\n"


def _write_doublings(scale: float, at: bytes) -> Iterator[bytes]:
    """Each prim has two children that inherit the prim before it."""
    yield b'class "d0" {}\n'
    for number in range(1, max(2, int(DOUBLINGS * min(1.0, scale**0.5))) + 1):
        inherits = b"(inherits = <%b/d%d>) {}" % (at, number - 1)
        yield b'class "d%d" {\n    def "one" %s\n    def "two" %s\n}\n' % (number, inherits, inherits)
    yield b'def Xform "all" (inherits = <%b/d%d>) {}\n' % (at, number)


def _list_of_large_numbers(_scale: float, at: bytes) -> Iterator[bytes]:
    """A PointInstancer whose numbers are as large as they can be."""
    large = b"%d" % (COUNT - 1)
    yield b"""def PointInstancer "p" (prepend apiSchemas = ["FoliageLeafAPI"]) {
    int64[] ids = [%d, 1]
    int64[] invisibleIds = [%d]
    int[] protoIndices = [%b, %b]
    point3f[] positions = [(0, 0, 0), (1e38, 1e38, 1e38)]
    float[] primvars:leaf:packed = [%d, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 20224]
    float primvars:leaf:edit:jitterFrequency = %d
    rel prototypes = <%b/p/b>
    def BasisCurves "b" { point3f[] points = [(0, 0, 0)]; int[] curveVertexCounts = [%b]; }
    def Mesh "c" { point3f[] points = [(0, 0, 0)]; int[] faceVertexCounts = [%b]; int[] faceVertexIndices = [%b]; }
    def NurbsPatch "d" { int uVertexCount = %b; int vVertexCount = %b; int uOrder = %b; int vOrder = 2; }
}
""" % (2**63 - 1, 2**63 - 1, large, large, COUNT, COUNT, at, large, large, large, large, large, large)  # fmt: skip
