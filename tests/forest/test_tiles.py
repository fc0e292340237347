"""Tiles: each place and each face is in one, and nothing is in none."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from usdfoliage.forest.tiles import MAX_TILES, split_mesh, tile_ground


def mesh(columns=9, rows=5, step_m=10.0, corner_m=(455_000.0, 4_660_000.0)):
    x, y = np.meshgrid(np.arange(columns) * step_m, np.arange(rows) * step_m)
    places_m = np.column_stack([x.ravel() + corner_m[0], y.ravel() + corner_m[1], np.zeros(x.size)])
    corner = np.arange(columns * rows).reshape(rows, columns)
    faces = np.stack([corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]], axis=-1)
    return places_m, faces.reshape(-1, 4).astype(np.int32)


def test_tiles_lie_at_multiples_of_their_size():
    places_m, _ = mesh()
    grid = tile_ground(places_m, 20.0)
    assert (grid.columns, grid.rows) == (4, 2)
    assert grid.origin_m.tolist() == [455_000.0, 4_660_000.0]
    assert tile_ground(places_m + 7.0, 20.0).origin_m.tolist() == [455_000.0, 4_660_000.0]
    assert (tile_ground(places_m + 7.0, 20.0).columns, tile_ground(places_m + 7.0, 20.0).rows) == (5, 3)
    assert [grid.name(number) for number in (0, 3, 7)] == ["tile_0_0", "tile_3_0", "tile_3_1"]


def test_a_place_on_an_edge_is_in_one_tile():
    places_m, _ = mesh()
    grid = tile_ground(places_m, 20.0)
    on_m = np.array([[455_020.0, 4_660_020.0], [455_019.999, 4_660_019.999], [455_080.0, 4_660_040.0]])
    assert grid.number(on_m).tolist() == [5, 0, 7]


def test_every_face_is_in_one_tile_and_seams_have_the_same_points():
    places_m, faces = mesh()
    grid = tile_ground(places_m, 20.0)
    split = split_mesh(faces, places_m, grid)
    assert len(split) == 8
    found = np.concatenate([points[corners] for points, corners in split.values()])
    assert sorted(map(tuple, found.tolist())) == sorted(map(tuple, faces.tolist()))
    west, east = set(split[0][0].tolist()), set(split[1][0].tolist())
    assert len(west & east) == 3


@examples(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1))
def test_every_place_lies_within_its_tile(seed):
    rng = np.random.default_rng(seed)
    places_m = rng.uniform(-1000, 1000, 2) + rng.uniform(0, 300, (200, 2))
    grid = tile_ground(places_m, float(rng.uniform(20, 400)))
    number = grid.number(places_m)
    corner_m = grid.origin_m + grid.tile_m * np.stack([number % grid.columns, number // grid.columns], axis=-1)
    assert (places_m >= corner_m - 1e-9).all()
    assert (places_m <= corner_m + grid.tile_m + 1e-9).all()
    assert (number < len(grid)).all()
    assert len({grid.name(each) for each in range(len(grid))}) == len(grid)


def test_too_many_tiles_are_refused():
    places_m, _ = mesh()
    with pytest.raises(ValueError, match=f"{MAX_TILES:,} are allowed"):
        tile_ground(places_m, 0.1)
