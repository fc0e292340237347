"""plants.toml: its rows, and errors that name the row."""

import pytest
from usdfoliage.errors import CaptureError
from usdfoliage.forest.kinds import PlantKind
from usdfoliage.forest.plants_file import read_plants_file

ROW = '[[plant]]\nspecies = "oak"\nkind = "tree"\nasset = "assets/oak"\nheight_m = [5, 13]\n'


def read(tmp_path, text: str):
    (tmp_path / "plants.toml").write_text(text)
    return read_plants_file(tmp_path / "plants.toml")


def test_rows_have_shares_of_their_kind_and_assets_beside_the_file(tmp_path):
    shrub = ROW.replace('"tree"', '"shrub"').replace("oak", "hazel")
    plants = read(tmp_path, f'{ROW}share = 3\n{ROW}share = 1\n{shrub}\n[classes]\n7 = "tree"\n9 = "none"\n')
    assert [row.share for row in plants.rows] == [0.75, 0.25, 1.0]
    assert plants.rows[0].asset == tmp_path / "assets" / "oak"
    assert plants.classes[7] == PlantKind.TREE
    assert plants.classes[9] is None
    assert plants.classes[1] == PlantKind.TREE


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "no [[plant]] row"),
        ("plant = 3", "no list of tables"),
        ("[[plant", "no TOML"),
        ("x = 1\n" + ROW, "unknown table x"),
        (ROW + "colour = [1, 2, 3]\n", "row 1 (oak)"),
        (ROW + ROW.replace("[5, 13]", "[13, 5]"), "row 2 (oak)"),
        (ROW.replace("[5, 13]", "7"), "height_m"),
        (ROW.replace("tree", "palm"), "kinds are tree, shrub, grass"),
        (ROW.replace('asset = "assets/oak"\n', ""), "has no asset"),
        (ROW + "share = -1\n", "share"),
        (ROW + "share = 0\n", "sum to 0"),
        (ROW + "color = [0, 0, 0]\n", "color"),
        (ROW + "form = 99\n", "form"),
        (ROW + "max_slope_deg = 120\n", "slope"),
        (ROW + "water_m = [0, 5]\n", "no class is water"),
        (ROW + "leaf = 5\n", "leaf that is no path"),
        (ROW + "leaf = ' '\n", "leaf that is no path"),
        (ROW + "water_m = [9, 5]\n[classes]\n9 = 'water'\n", "nearer first"),
        (ROW + "elevation_m = [9, 1]\n", "elevation_m"),
        (ROW + "[classes]\nx = 'tree'\n", "[classes]"),
    ],
)
def test_what_cannot_be_is_one_clear_line(tmp_path, text, what):
    with pytest.raises(CaptureError) as refused:
        read(tmp_path, text)
    assert what in str(refused.value)
    assert "plants.toml" in str(refused.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(CaptureError, match=r"nowhere\.toml"):
        read_plants_file(tmp_path / "nowhere.toml")
