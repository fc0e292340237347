"""EXIF of files that OpenImageIO does not read."""

import struct

import numpy as np
import OpenImageIO as oiio
import pytest
from hypothesis import given
from hypothesis import strategies as st
from usdfoliage.capture.folder.exif import as_image_spec, read_exif

from tests.support.heic_files import exif_block


def test_it_reads_what_openimageio_writes(tmp_path):
    """Its EXIF of a JPEG, read by it and by us, is the same."""
    spec = oiio.ImageSpec(32, 16, 3, oiio.UINT8)
    stated = {"Make": "Apple", "Model": "iPhone 13 Pro", "Orientation": 6, "Exif:FocalLengthIn35mmFilm": 26}
    for name, value in stated.items():
        spec.attribute(name, value)
    spec.attribute("Exif:FocalLength", 5.7)
    spec.attribute("GPS:LatitudeRef", "S")
    spec.attribute("GPS:Latitude", oiio.TypeDesc("float[3]"), (44.0, 51.0, 1.72))
    spec.attribute("GPS:Altitude", 29.25)
    out = oiio.ImageOutput.create(str(tmp_path / "a.jpg"))
    assert out.open(str(tmp_path / "a.jpg"), spec)
    assert out.write_image(np.zeros((16, 32, 3), np.uint8))
    out.close()
    stored = (tmp_path / "a.jpg").read_bytes()
    found = read_exif(stored[stored.index(b"Exif\0\0") + 6 :])
    assert {name: found[name] for name in stated} == stated
    assert found["GPS:LatitudeRef"] == "S"
    assert found["GPS:Latitude"] == pytest.approx((44, 51, 1.72))
    again = as_image_spec(32, 16, found)
    assert again.get_int_attribute("Exif:FocalLengthIn35mmFilm") == 26
    assert again.get_float_attribute("Exif:FocalLength") == pytest.approx(5.7)
    assert again.getattribute("GPS:Latitude") == pytest.approx((44, 51, 1.72))


def test_what_is_no_exif_has_no_values():
    for block in (b"", b"II", b"MM\0\x2a", b"II\x2a\0\xff\xff\xff\xff", b"GIF89a" + bytes(50)):
        assert read_exif(block) == {}


def test_a_folder_that_leads_to_itself_ends():
    block = exif_block({0x0112: (3, 6)}, {})
    loop = block.replace(struct.pack(">HHII", 0x8769, 4, 1, struct.unpack_from(">I", block, 30)[0]), b"")
    assert read_exif(loop)["Orientation"] == 6
    assert read_exif(block[:26] + struct.pack(">HHII", 0x8769, 4, 1, 8) + block[38:])["Orientation"] == 6


@given(st.binary(max_size=300), st.sampled_from([b"II\x2a\0\x08\0\0\0", b"MM\0\x2a\0\0\0\x08"]))
def test_any_bytes_give_values_or_none(data, start):
    as_image_spec(10, 10, read_exif(start + data))
