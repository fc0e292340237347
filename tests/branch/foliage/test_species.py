"""The library of species, and files that extend it."""

import numpy as np
import pytest
from usdfoliage.branch.foliage.place import place_leaves
from usdfoliage.branch.foliage.species import GENERIC, describe_species, load_library, load_species
from usdfoliage.errors import FoliageError
from usdfoliage.leaf.shape.fold import find_folds
from usdfoliage.leaf.shape.measures import leaf_width
from usdfoliage.leaf.shape.variation import leaf_of_width
from usdfoliage.remarks import Argument

from tests.support.branch_shapes import plant_of

TABLE_2 = {  # internode, roll, branching, gamma
    "pentagon-maple": (0.050, 120, 38, 0.45),
    "peach": (0.038, 97, 37, 0.50),
    "laurel": (0.051, 95, 35, 0.43),
    "maple": (0.049, 130, 34, 0.42),
    "prunus": (0.052, 87, 41, 0.43),
    "cercis": (0.051, 100, 38, 0.41),
}
NAMES = sorted(load_library())


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("name", TABLE_2)
def test_the_papers_species_are_as_in_its_table(name):
    species = load_species(name)
    angles = np.degrees([species.roll_rad, species.branching_rad])
    assert (species.internode_m, *angles, species.exponent) == pytest.approx(TABLE_2[name])


@pytest.mark.parametrize("name", NAMES)
def test_every_species_carries_leaves_that_are_leaves(name):
    species = load_species(name)
    twig = plant_of(([[0, 0, 0], [0, 0.2, 0]], species.twig_radius_m, None, -1))
    places = place_leaves(twig, species, np.random.default_rng(0))
    assert len(places) >= species.leaves_per_node
    assert len(places) % species.leaves_per_node == 0
    assert (places.length_m > 0).all()
    leaf = leaf_of_width(species.leaf_width)[None]
    assert leaf_width(leaf)[0] == pytest.approx(species.leaf_width, rel=1e-6)
    assert not find_folds(leaf)[0]


def test_a_name_is_found_however_it_is_written():
    assert load_species("  Pentagon Maple").name == load_species("PENTAGON_maple").name == "pentagon-maple"


def test_the_error_of_an_unknown_name_lists_the_known_ones(tmp_path):
    with pytest.raises(FoliageError, match=r"no species 'mapel'; the library has alder, apple.*willow; ") as refused:
        load_species("mapel")
    assert Argument(name="species_file") in refused.value.remedy
    extra = write(tmp_path / "mine.toml", "[yew]\n")
    with pytest.raises(FoliageError, match=r"the library and .*mine\.toml have .*yew"):
        load_species("mapel", extra)


def test_a_file_changes_and_adds_species(tmp_path):
    extra = write(
        tmp_path / "mine.toml", "[Maple]\nleaf_length_m = 0.2\n[yew]\ndivergence_deg = 180\nleaf_width = 0.1\n"
    )
    maple, plain = load_species("maple", extra), load_species("maple")
    assert maple.leaf_length_m == 0.2
    assert (maple.leaves_per_node, maple.exponent) == (plain.leaves_per_node, plain.exponent)
    yew, generic = load_species("Yew", extra), load_species(GENERIC)
    assert (yew.divergence_rad, yew.leaf_width) == (pytest.approx(np.pi), 0.1)
    assert (yew.internode_m, yew.color) == (generic.internode_m, generic.color)
    assert load_species("maple") == plain


@pytest.mark.parametrize(
    ("text", "about"),
    [
        ("[oak\n", "no TOML"),
        ("leaf_width = 1\n", r"leaf_width = 1 stands in none"),
        ("[oak]\nleaf_witdh = 1\n", r"species oak: there is no leaf_witdh; there are internode_m.*color"),
        ("[oak]\nleaf_width = 'wide'\n", r"species oak: leaf_width must be a number, not 'wide'"),
        ("[oak]\nleaf_width = true\n", r"species oak: leaf_width must be a number, not True"),
        ("[oak]\nleaf_width = nan\n", r"species oak: leaf_width must be 0\.02 to 1\.5, not nan"),
        ("[oak]\nleaf_width = 7\n", r"species oak: leaf_width must be 0\.02 to 1\.5, not 7"),
        ("[oak]\ndivergence_deg = 400\n", r"species oak: divergence_deg must be 0 to 360, not 400"),
        ("[oak]\nleaves_per_node = 1.5\n", r"species oak: leaves_per_node must be a whole number, not 1\.5"),
        ("[oak]\nleaves_per_node = 0\n", r"species oak: leaves_per_node must be 1 to 24, not 0"),
        ("[oak]\ncolor = [1, 2]\n", r"species oak: color must be three numbers from 0 to 1, not \[1\.0, 2\.0\]"),
        ("[oak]\ncolor = 'green'\n", r"species oak: color must be a list of three numbers, not 'green'"),
        ("[yew]\ninternode_m = -1\n", r"species yew: internode_m must be 0\.0001 to 2, not -1"),
    ],
)
def test_what_cannot_be_is_named_with_file_species_and_key(tmp_path, text, about):
    with pytest.raises(FoliageError, match=rf"{about}.*\(.*mine\.toml\)"):
        load_species("oak", write(tmp_path / "mine.toml", text))


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(FoliageError, match=r"No such file.*none\.toml"):
        load_species("oak", tmp_path / "none.toml")


@pytest.mark.parametrize("name", ["maple", "generic", "willow"])
def test_a_description_of_a_species_can_be_read_as_a_file(tmp_path, name):
    species = load_species(name)
    values = dict(each.split(" ", 1) for each in describe_species(species).split(", "))
    values["color"] = f"[{values['color'].replace(' ', ', ')}]"
    extra = write(tmp_path / "mine.toml", "[copy]\n" + "\n".join(f"{key} = {value}" for key, value in values.items()))
    assert describe_species(load_species("copy", extra)) == describe_species(species)
