"""Coordinate systems as files state them, and which of them have lengths across."""

import numpy as np
import pytest
from rasterio.crs import CRS
from usdfoliage.errors import CaptureError
from usdfoliage.forest.coordinate_system import check_system, metres_per_unit, system_of


@pytest.mark.parametrize("code", ["25831", "25831+5773"])
def test_the_system_across_is_found_without_that_of_heights(code):
    found = system_of(CRS.from_user_input(f"EPSG:{code}").to_wkt(), None)
    assert found.to_epsg() == 25831
    assert metres_per_unit(found) == 1.0


def test_a_number_is_taken_where_the_text_cannot_be_used():
    assert system_of('PROJCS["a', 2263).to_epsg() == 2263
    assert metres_per_unit(system_of("", 2263)) == pytest.approx(1200 / 3937)


@pytest.mark.parametrize(
    ("text", "epsg"), [("", None), ("x" * 5000, 31000), ('LOCAL_CS["a",UNIT["metre",1]]', None), ("", 4978)]
)
def test_what_is_no_system_of_the_ground_is_none(text, epsg):
    assert system_of(text, epsg) is None
    assert metres_per_unit(None) == 1.0


@pytest.mark.parametrize(("latitude", "zone"), [(41.0, "EPSG:32631"), (-41.0, "EPSG:32731")])
def test_degrees_are_refused_with_the_zone_to_use(latitude, zone):
    with pytest.raises(CaptureError, match=f"a.las is in degrees .* with 'gdalwarp -t_srs {zone}'"):
        check_system(CRS.from_epsg(4326), np.array([2.5, latitude]), "a.las", "'gdalwarp -t_srs {}'")


def test_metres_of_web_maps_are_refused():
    with pytest.raises(CaptureError, match="web maps"):
        check_system(CRS.from_epsg(3857), np.zeros(2), "a.las", "PDAL to {}")
