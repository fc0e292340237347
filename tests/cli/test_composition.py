"""How large the layers of an asset are, found without USD and without trust in any of them."""

import os
import random
import struct
import time
import zipfile

import pytest
from pxr import Sdf
from usdfoliage.cli.composition import MAX_TEXT_BYTES, measure_composition

BLOCK = 4096  # files count for what they take on the disk
LARGE = 1 << 20


def disk_bytes(*paths):
    return sum(path.stat().st_blocks * 512 for path in paths)


def write_crate(path, *, references=(), payloads=(), sublayers=(), points=0):
    layer = Sdf.Layer.CreateNew(str(path))
    for number, (each, kind) in enumerate([*((x, 0) for x in references), *((x, 1) for x in payloads)]):
        prim = Sdf.CreatePrimInLayer(layer, f"/a{number}")
        if kind:
            prim.payloadList.Prepend(Sdf.Payload(each))
        else:
            prim.referenceList.Prepend(Sdf.Reference(each))
    layer.subLayerPaths[:] = list(sublayers)
    if points:
        prim = Sdf.CreatePrimInLayer(layer, "/points")
        random.seed(1)
        Sdf.AttributeSpec(prim, "x", Sdf.ValueTypeNames.FloatArray).default = [random.random() for _ in range(points)]
    assert layer.Save()
    return path


@pytest.fixture
def places(tmp_path):
    for name in ("scene", "library", "library/payload", "library/maps"):
        (tmp_path / name).mkdir()
    return tmp_path / "scene", tmp_path / "library"


@pytest.mark.parametrize("suffix", [".usda", ".usdc"])
def test_layers_elsewhere_count_with_all_that_their_asset_has(places, suffix):
    scene, library = places
    bulk = write_crate(library / "payload" / "bulk.usdc", points=300_000)
    plant = write_crate(library / "plant.usdc", payloads=["./payload/bulk.usdc"])
    (library / "maps" / "x.png").write_bytes(b"0" * LARGE)
    file = scene / f"scene{suffix}"
    if suffix == ".usdc":
        write_crate(file, references=["../library/plant.usdc"], sublayers=[f"./no_{k}.usda" for k in range(300)])
    else:
        file.write_text('#usda 1.0\ndef "a" (references = @../library/plant.usdc@</a0>) {}\n')
    (scene / "notes.txt").write_bytes(b"0" * LARGE)
    expected = disk_bytes(bulk, plant, library / "maps" / "x.png", file, scene / "notes.txt")
    for asset in (scene, file):
        assert measure_composition(asset).size_bytes == expected
    assert expected > 2 * LARGE


def test_what_a_look_stands_beside_does_not_count(places):
    scene, _ = places
    (scene / "a.usda").write_text("#usda 1.0\n")
    (scene / "b.usda").write_text("#usda 1.0\n" + "# \n" * LARGE)
    assert measure_composition(scene / "a.usda").size_bytes == disk_bytes(scene / "a.usda")
    assert measure_composition(scene / "b.usda").text_bytes > LARGE


def test_only_layers_elsewhere_count(places):
    scene, library = places
    os.mkfifo(library / "pipe.usda")
    (library / "film.usdc").write_bytes(b"no layer" * LARGE)
    (library / "loop.usda").symlink_to("loop.usda")
    names = ("pipe.usda", "film.usdc", "loop.usda", "none.usda", "../scene/scene.usda", "maps.usda", "x\0y.usda")
    (library / "maps.usda").mkdir()
    lines = "".join(f"@../library/{name}@\n" for name in (*names, "x" * 3000 + ".usda"))
    (scene / "scene.usda").write_text(f"#usda 1.0\n{lines}@/dev/zero.usda@ @{'x' * 9000}")
    assert measure_composition(scene).size_bytes == disk_bytes(scene / "scene.usda")


def write_package(path, members):
    """A package as USD makes them: what is in it is stored as it is."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


def test_text_in_packages_counts_as_text(tmp_path):
    text = b"#usda 1.0\n" + b"# \n" * LARGE
    picture = b"0" * 2 * LARGE
    inner = write_package(tmp_path / "inner.usdz", {"b.usda": text, "c.png": picture}).read_bytes()
    for members, expected in (
        ({"a.usdc": b"PXR-USDC" + picture, "c.png": picture}, 0),
        ({"a.usda": b"#usda 1.0\n", "a.usd": text}, len(text)),
        ({"a.usdc": b"PXR-USDC", "inner.usdz": inner}, len(text)),
    ):
        package = write_package(tmp_path / "a.usdz", members)
        found = measure_composition(package)
        assert found.text_bytes == expected
        assert found.text == (package if expected else None)
        assert found.size_bytes >= len(package.read_bytes())


def test_damaged_packages_are_measured_without_a_fault(tmp_path):
    inner = write_package(tmp_path / "inner.usdz", {f"{k}.usda": "#usda 1.0\n" for k in range(20)}).read_bytes()
    path = write_package(tmp_path / "a.usdz", {f"{k}.usdz": inner for k in range(20)})
    whole = path.read_bytes()
    rng = random.Random(5)
    began = time.process_time()
    for _ in range(400):
        data = bytearray(whole[: rng.randrange(8, len(whole))] if rng.random() < 0.2 else whole)
        for _ in range(rng.randrange(1, 30)):
            data[rng.choice([rng.randrange(len(data)), -1 - rng.randrange(min(2000, len(data)))])] = rng.randrange(256)
        path.write_bytes(data)
        measure_composition(path)
    assert time.process_time() - began < 60


def test_a_package_that_lists_itself_is_measured_once_and_for_all(tmp_path):
    """Each of its entries is the package from its beginning: in each other they would never end."""
    path = write_package(tmp_path / "a.usdz", {f"{k}.usdz": b"PK\x03\x04" for k in range(500)})
    data = bytearray(path.read_bytes())
    at = data.find(b"PK\x01\x02")
    while at >= 0:
        struct.pack_into("<I", data, at + 24, len(data))
        at = data.find(b"PK\x01\x02", at + 4)
    path.write_bytes(data)
    began = time.process_time()
    assert measure_composition(path).text_bytes == 0
    assert time.process_time() - began < 20


def test_damaged_crates_are_measured_without_a_fault(places):
    scene, _ = places
    path = write_crate(scene / "a.usdc", references=[f"../library/x{k}.usda" for k in range(200)])
    whole = path.read_bytes()
    rng = random.Random(5)
    began = time.process_time()
    for _ in range(400):
        data = bytearray(whole[: rng.randrange(8, len(whole))] if rng.random() < 0.2 else whole)
        for _ in range(rng.randrange(1, 30)):
            at = rng.choice([rng.randrange(len(data)), rng.randrange(min(96, len(data)))])
            data[at] = rng.choice([0, 1, 127, 255, rng.randrange(256)])
        path.write_bytes(data)
        found = measure_composition(path)
        assert found.size_bytes <= disk_bytes(path)
    assert time.process_time() - began < 60


def test_chains_and_texts_without_end_are_bounded(places):
    _, library = places
    for number in range(2000):
        (library / f"{number}.usda").write_text(f"#usda 1.0\n( subLayers = [@{number + 1}.usda@, @0.usda@] )\n")
    with (library / "2000.usda").open("wb") as file:
        file.write(b"#usda 1.0\n" + b"@a.usda@ @" * 100)
        file.truncate(20 * MAX_TEXT_BYTES)
    began = time.process_time()
    found = measure_composition(library / "0.usda")
    assert time.process_time() - began < 30
    assert found.text_bytes == 20 * MAX_TEXT_BYTES
    assert found.text == library / "2000.usda"
