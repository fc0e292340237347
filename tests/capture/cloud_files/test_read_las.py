"""LAS and LAZ: units of their coordinate systems, marked points are left out, damage is reported."""

import struct

import laspy
import numpy as np
import pytest
from laspy.vlrs.known import GeoKeyDirectoryVlr, GeoKeyEntryStruct, WktCoordinateSystemVlr
from usdfoliage.capture.cloud_files.las import open_las_parts, read_las_system
from usdfoliage.capture.cloud_files.las_units import LasSystem, LasUnit, read_key_unit, read_wkt_unit
from usdfoliage.capture.cloud_files.read import CloudInputSettings, read_cloud_input
from usdfoliage.errors import CaptureError
from usdfoliage.remarks import Setting

from tests.support.cloud_files import some_colors, some_points, write_las

WGS84 = 'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257]],UNIT["degree",0.0174532925]]'
FEET = f'PROJCS["somewhere (ftUS)",{WGS84},PROJECTION["Lambert"],UNIT["US survey foot",0.3048006096012192]]'
METRES = f'PROJCS["UTM 32N",{WGS84},PROJECTION["Transverse_Mercator"],UNIT["metre",1],AXIS["Easting",EAST]]'
NEW = (
    'PROJCRS["UTM",BASEGEOGCRS["WGS 84",ANGLEUNIT["degree",0.0174532925]],CS[Cartesian,2],'
    'AXIS["(E)",east,ORDER[1],LENGTHUNIT["foot",0.3048]],AXIS["(N)",north,ORDER[2],LENGTHUNIT["foot",0.3048]]]'
)


def keys(*entries: tuple[int, int]) -> GeoKeyDirectoryVlr:
    record = GeoKeyDirectoryVlr()
    record.geo_keys = [GeoKeyEntryStruct(id=number, tiff_tag_location=0, count=1, value_offset=value)
                       for number, value in entries]  # fmt: skip
    record.geo_keys_header.number_of_keys = len(entries)
    return record


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        (FEET, LasUnit(0.3048006096012192)),
        (METRES, LasUnit(1.0)),
        (NEW, LasUnit(0.3048)),
        (WGS84, LasUnit(is_degrees=True)),
        (f'COMPD_CS["both",{METRES},VERT_CS["h",VERT_DATUM["d",2005],UNIT["foot",0.3048]]]', LasUnit(1.0, 0.3048)),
        ('LOCAL_CS["here",UNIT["metre",1]]', LasUnit(1.0)),
        ("", LasUnit()),
        ("]]]][[[,,,\"", LasUnit()),
        ('PROJCS["no number",UNIT["metre",one]]', LasUnit()),
    ],
)  # fmt: skip
def test_units_in_well_known_text(text, unit):
    assert read_wkt_unit(text) == unit


def test_units_in_keys():
    assert read_key_unit([(3076, 0, 1, 9003)], []) == LasUnit(1200 / 3937)
    assert read_key_unit([(3076, 0, 1, 9001), (4099, 0, 1, 9002)], []) == LasUnit(1.0, 0.3048)
    assert read_key_unit([(3072, 0, 1, 2263)], []) == LasUnit(epsg=2263)
    assert read_key_unit([(1024, 0, 1, 2)], []) == LasUnit(is_degrees=True)
    assert read_key_unit([(3076, 0, 1, 32767), (3077, 34736, 1, 1)], [7.0, 0.9144]) == LasUnit(0.9144)
    assert read_key_unit([(3077, 34736, 1, 5)], []) == LasUnit()


@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize("record", [WktCoordinateSystemVlr(FEET), keys((1024, 1), (3076, 9003))])
def test_feet_become_metres(tmp_path, suffix, record):
    path = write_las(tmp_path / f"a{suffix}", some_points(), vlrs=[record])
    cloud = read_cloud_input(path)
    assert cloud.metres_per_unit == pytest.approx(1200 / 3937)
    np.testing.assert_allclose(cloud.points_m + cloud.origin_m, some_points() * 1200 / 3937, atol=1e-9)
    assert [each.text for each in cloud.remarks] == ["the file's unit is 0.304801 m"]
    given = read_cloud_input(path, CloudInputSettings(metres_per_unit=1.0))
    assert given.metres_per_unit == 1
    assert [each.text for each in given.remarks] == ["the file states 0.304801 m a unit; 1 is used as given"]


def test_without_a_unit_las_is_in_metres_however_large(tmp_path):
    cloud = read_cloud_input(write_las(tmp_path / "a.las", 1000 * some_points()))
    assert cloud.metres_per_unit == 1
    assert "as in most LAS files" in cloud.remarks[0].text
    assert Setting(name="capture.toml:metres_per_unit") in cloud.remarks[0].remedy
    assert cloud.format_up == "+Z"
    named = read_cloud_input(write_las(tmp_path / "b.las", some_points(), vlrs=[keys((3072, 2263))]))
    assert "EPSG:2263, whose unit is not looked up" in named.remarks[0].text


def test_degrees_and_mixed_units_are_refused(tmp_path):
    points = some_points() * [1e-5, 1e-5, 1.0] + [11.5, 48.1, 500]
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [1e-9, 1e-9, 0.001], [11.5, 48.1, 500]
    header.vlrs.append(WktCoordinateSystemVlr(WGS84))
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    las.write(tmp_path / "a.las")
    with pytest.raises(CaptureError, match="degrees of longitude and latitude; project it"):
        read_cloud_input(tmp_path / "a.las")
    local = read_cloud_input(write_las(tmp_path / "b.las", some_points(), vlrs=[WktCoordinateSystemVlr(WGS84)]))
    assert "too far apart" in local.remarks[0].text
    both = f'COMPD_CS["b",{FEET},VERT_CS["h",UNIT["metre",1]]]'
    path = write_las(tmp_path / "c.las", some_points(), vlrs=[WktCoordinateSystemVlr(both)])
    with pytest.raises(CaptureError, match=r"0.304801 m across and of 1 m in height"):
        read_cloud_input(path)
    assert read_cloud_input(path, CloudInputSettings(metres_per_unit=1.0)).metres_per_unit == 1


def test_withheld_points_and_noise_are_left_out(tmp_path):
    withheld = np.arange(200) < 7
    classes = np.where(np.arange(200) > 188, 7, 1)
    path = write_las(tmp_path / "a.laz", some_points(), withheld=withheld, classification=classes)
    cloud = read_cloud_input(path)
    assert len(cloud.points_m) == 182
    assert cloud.total == 200
    assert "7 points that the file marks as withheld left out" in [each.text for each in cloud.remarks]
    assert "11 points that the file marks as noise left out" in [each.text for each in cloud.remarks]


@pytest.mark.parametrize("scale", [1, 257])
def test_colours_of_8_and_16_bits(tmp_path, scale):
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales = [0.001] * 3
    las = laspy.LasData(header)
    las.x, las.y, las.z = some_points().T
    las.red, las.green, las.blue = some_colors().T * scale
    las.write(tmp_path / "a.las")
    np.testing.assert_array_equal(read_cloud_input(tmp_path / "a.las").colors, some_colors())


def test_black_is_no_colour(tmp_path):
    cloud = read_cloud_input(write_las(tmp_path / "a.las", some_points(), np.zeros((200, 3), int)))
    assert cloud.colors is None
    assert "cloud-colors-black" in [each.code for each in cloud.remarks]


@pytest.mark.parametrize("damage", ["chunks", "chunk size", "points", "signature", "scale", "records", "late records"])
def test_damage_is_reported(tmp_path, damage):
    path = write_las(tmp_path / "a.laz", some_points())
    data = bytearray(path.read_bytes())
    start = struct.unpack_from("<I", data, 96)[0]
    if damage == "chunks":
        struct.pack_into("<I", data, struct.unpack_from("<q", data, start)[0] + 4, 4_000_000_000)
    elif damage == "chunk size":  # for which lazrs would end the process
        struct.pack_into("<I", data, data.find(b"laszip encoded") - 2 + 54 + 12, 2**31 - 1)
    elif damage == "points":
        struct.pack_into("<Q", data, 247, 10**12)
    elif damage.endswith("records"):
        struct.pack_into("<I", data, 100 if damage == "records" else 243, 4_000_000_000)
    elif damage == "signature":
        data[:4] = b"LASX"
    else:
        struct.pack_into("<d", data, 131, np.nan)
    path.write_bytes(data)
    with pytest.raises(CaptureError, match=r"a\.laz is damaged"):
        read_cloud_input(path)


def test_the_coordinate_system_and_the_classes_are_handed_on(tmp_path):
    points = some_points()
    codes = np.arange(200) % 9
    file = write_las(tmp_path / "a.las", points, classification=codes, vlrs=[WktCoordinateSystemVlr(METRES)])
    assert read_las_system(file) == LasSystem(METRES, LasUnit(1.0))
    (part,) = open_las_parts(file).parts
    np.testing.assert_array_equal(part.classes, codes)
    assert read_las_system(write_las(tmp_path / "b.las", points)) == LasSystem()
    numbered = write_las(tmp_path / "c.las", points, vlrs=[keys((1024, 1), (3072, 25832))])
    assert read_las_system(numbered) == LasSystem("", LasUnit(epsg=25832))
    (tmp_path / "d.las").write_bytes(b"LASF" + bytes(300))
    with pytest.raises(CaptureError, match=r"d\.las is damaged"):
        read_las_system(tmp_path / "d.las")
