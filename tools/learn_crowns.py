#!/usr/bin/env python3
"""Learn by what crowns are recognised from above, from forests whose every tree is known, and write the weights.

usage: tools/learn_crowns.py [--seed 100] [--forests 32] [--only photo|canopy] [-o WEIGHTS.toml]

The forests are those of tools/synthetic_forest.py, of random relief, density, crowns, species, pixels and sun. A cell
is worth the intersection over union of its disc with the crown that it covers best; lit from a wrong side, half of
that. Half of the canopies have noise and holes. After the first turn more is learned from cells whose answers are
wrong.
"""

import argparse
import itertools
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from usdfoliage.forest import crown_search
from usdfoliage.forest.crown_search import crown_radii, read_weights, shared_area
from usdfoliage.forest.crown_tiles import cut_tiles, cut_windows, middles_m, tile_facts
from usdfoliage.forest.raster import Raster
from usdfoliage.forest.raster_files import read_raster
from usdfoliage.forest.tree_tops import fill_canopy
from usdfoliage.geometry.color import decode_srgb

from tools.synthetic_forest import Scene, Species, make

OUTPUT = Path(crown_search.__file__).with_name("crown_weights.toml")
HIDDEN = (28, 14)
CELLS = 350  # of 4,000 candidates of a radius, that are learned from
MAX_TILES = 4  # such numbers of candidates, that count
RADII_M = 0.8, 8.0
COARSE_M = 0.7  # cells of a canopy that are not made larger
WRONG_SIDE = 0.5
BATCH, STEPS = 512, 6000
TURNS = 2
STEP = 3  # of the cells in a tile, one in so many rows and columns is a candidate

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Network:
    """Middle and spread of facts, and matrix and offset of each layer."""

    middle: NDArray[np.float32]
    spread: NDArray[np.float32]
    layers: list[tuple[NDArray[np.float32], NDArray[np.float32]]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Lesson:
    """Cells of forests, and what they are worth."""

    facts: NDArray[np.float32]  # (N, K)
    worth: NDArray[np.float32]  # (N,)


def random_scene(seed: int) -> Scene:
    """A forest of random kind."""
    rng = np.random.default_rng(seed)

    def species(number: int) -> Species:
        cone = float(rng.choice([0.0, 0.0, 0.0, 0.5, 0.9]))
        low = rng.uniform(4, 12)
        green = np.array([rng.uniform(0.04, 0.16), rng.uniform(0.08, 0.19), rng.uniform(0.03, 0.07)])
        other = np.array([rng.uniform(0.1, 0.26), rng.uniform(0.05, 0.17), rng.uniform(0.02, 0.08)])
        color = green if rng.random() < 0.7 else other
        return Species(
            name=f"kind {number}",
            share=float(rng.uniform(0.2, 1)),
            height_m=(low, low * rng.uniform(1.6, 2.8)),
            color=tuple(color.tolist()),
            form=float(rng.uniform(0.11, 0.2) if cone else rng.uniform(0.18, 0.36)),
            cone=cone,
        )

    pixel_m = float(rng.choice([0.2, 0.25, 0.25, 0.25, 0.4, 0.5, 1.0]))
    grass = np.array([rng.uniform(0.09, 0.16), rng.uniform(0.13, 0.22), rng.uniform(0.05, 0.10)])
    earth = np.array([0.2, 0.165, 0.10]) * rng.uniform(0.6, 1.4) * rng.uniform(0.9, 1.1, 3)
    smallest = float(rng.uniform(0.8, 2.0))
    return Scene(
        name=f"lesson_{seed}",
        seed=seed,
        species=tuple(species(number) for number in range(int(rng.integers(1, 5)))),
        side_m=160.0 if pixel_m == 1.0 else 120.0,
        relief_m=float(rng.uniform(2, 40)),
        steepest_deg=float(rng.uniform(3, 40)),
        wooded=float(rng.uniform(0.3, 0.95)),
        trees_per_ha=float(np.exp(rng.uniform(np.log(80), np.log(1000)))),
        radius_m=(smallest, float(rng.uniform(3.5, 8.0))),
        pixel_m=pixel_m,
        cell_m=1.0 if pixel_m == 1.0 else 2 * pixel_m,
        sun_deg=(float(rng.uniform(0, 360)), float(rng.uniform(25, 65))),
        noise=float(rng.uniform(0.005, 0.04)),
        leafy=float(rng.uniform(0.03, 0.3)),
        roads=int(rng.integers(0, 3)),
        roofs=int(rng.integers(0, 4)),
        ground=(tuple(grass.tolist()), tuple(earth.tolist())),
        ambient=float(rng.uniform(0.2, 0.6)) if rng.random() < 0.85 else 6.0,  # under clouds
        bumps=float(rng.uniform(0.0, 0.08)),
    )


def circle_overlap(place_m: Array, radius_m: float, trees: Array) -> Array:
    """(N,) the largest intersection over union of discs at places (N, 2) with crowns, columns 0, 1 and 3 of trees."""
    best = np.zeros(len(place_m))
    count = min(4, len(trees))
    away, near = (np.asarray(each) for each in cKDTree(trees[:, :2]).query(place_m, k=[*range(1, count + 1)]))
    for number in range(count):
        other_m = trees[near[:, number], 3]
        shared = shared_area(away[:, number], np.full_like(other_m, radius_m), other_m)
        best = np.maximum(best, shared / (np.pi * (radius_m**2 + other_m**2) - shared))
    return best


def read_photo(folder: Path) -> Raster:
    """The orthophoto of a forest, linear."""
    raster = read_raster(folder / "orthophoto.tif", "the orthophoto").raster
    linear = np.asarray(decode_srgb(np.clip(raster.values / 255, 0, 1)), np.float32)
    return Raster(values=linear, ground_from_pixel=raster.ground_from_pixel, crs=raster.crs)


def read_canopy(folder: Path, rng: np.random.Generator) -> Raster:
    """The canopy of a forest: every second one has noise and holes, every second fine one larger cells."""
    raster = read_raster(folder / "canopy_height.tif", "the canopy height").raster
    height_m = raster.values.astype(np.float64)
    factor = int(rng.choice([1, 2])) if raster.cell_m < COARSE_M else 1
    height, width = (size // factor for size in height_m.shape)
    blocks = height_m[: height * factor, : width * factor].reshape(height, factor, width, factor)
    height_m = blocks.max(axis=(1, 3))  # as canopies are made: the highest point of a cell
    if rng.random() < 0.5:
        height_m += rng.uniform(0.1, 0.6) * rng.standard_normal(height_m.shape)
        height_m[rng.random(height_m.shape) < 0.05] = np.nan
    matrix = raster.ground_from_pixel @ np.diag([factor, factor, 1.0])
    return Raster(values=fill_canopy(height_m), ground_from_pixel=matrix, crs=raster.crs)


def learn_from(
    picture: Raster, trees: Array, sun_deg: float, rng: np.random.Generator, known: Network | None
) -> Lesson:
    """Cells of one forest: more of those on crowns, and of those that are answered wrongly."""
    facts, worth = [], []
    for window in cut_windows(picture, RADII_M[1]):
        for radius in crown_radii(RADII_M, picture.cell_m):
            turns = [(float(rng.uniform(-12, 12)), 1.0)]
            if picture.values.ndim == 3:
                turns.append((float(rng.uniform(45, 315)), WRONG_SIDE))
            tiles = cut_tiles(window, radius, [sun_deg + turn for turn, _factor in turns])
            for tile, (_turn, factor) in zip(tiles, turns, strict=True):
                mask = np.zeros(tile.seen.shape, bool)
                mask[::STEP, ::STEP] = tile.seen[::STEP, ::STEP]
                if not mask.any():
                    continue
                found = tile_facts(tile, mask)
                value = factor * circle_overlap(middles_m(picture, tile, mask), radius, trees)
                odds = 0.03 + value**2
                if known is not None:
                    odds += 3 * np.abs(answer_of(found, known) - value) ** 2
                wanted = int((CELLS if factor == 1 else CELLS // 4) * (min(len(value) / 4000, MAX_TILES) + 0.02))
                taken = rng.choice(len(odds), min(wanted, len(value)), replace=False, p=odds / odds.sum())
                facts.append(found[taken])
                worth.append(value[taken])
    return Lesson(facts=np.concatenate(facts), worth=np.concatenate(worth).astype(np.float32))


def answer_of(facts: NDArray[np.float32], network: Network) -> NDArray[np.float32]:
    """(N,) what the network answers."""
    answer = np.clip((facts - network.middle) / network.spread, -4, 4).astype(np.float32)
    for number, (matrix, offset) in enumerate(network.layers):
        answer = answer @ matrix + offset
        answer = np.maximum(answer, 0) if number < len(network.layers) - 1 else answer
    return 1 / (1 + np.exp(-answer[:, 0]))


def fit_network(lesson: Lesson, rng: np.random.Generator) -> Network:
    """Layers that answer the worth of cells, by Adam (Kingma and Ba 2015) on the cross entropy."""
    middle, spread = lesson.facts.mean(axis=0), lesson.facts.std(axis=0) + 1e-3
    inputs = np.clip((lesson.facts - middle) / spread, -4, 4).astype(np.float32)
    sizes = (inputs.shape[1], *HIDDEN, 1)
    weights = [(rng.standard_normal((a, b)) * np.sqrt(2 / a)).astype(np.float32) for a, b in itertools.pairwise(sizes)]
    offsets = [np.zeros(b, np.float32) for b in sizes[1:]]
    offsets[-1][:] = -1.5
    numbers = weights + offsets
    first, second = [np.zeros_like(each) for each in numbers], [np.zeros_like(each) for each in numbers]
    for step in range(STEPS):
        batch = rng.integers(0, len(inputs), BATCH)
        values = [inputs[batch] + 0.05 * rng.standard_normal((BATCH, sizes[0])).astype(np.float32)]
        for number, (matrix, offset) in enumerate(zip(weights, offsets, strict=True)):
            value = values[-1] @ matrix + offset
            values.append(np.maximum(value, 0) if number < len(weights) - 1 else value)
        back = (1 / (1 + np.exp(-values[-1])) - lesson.worth[batch, None]) / BATCH
        slopes_w, slopes_b = [], []
        for number in reversed(range(len(weights))):
            slopes_w.insert(0, values[number].T @ back + 1e-5 * weights[number])
            slopes_b.insert(0, back.sum(axis=0))
            back = (back @ weights[number].T) * (values[number] > 0)
        rate = 3e-3 * 0.5 * (1 + np.cos(np.pi * step / STEPS))
        for each, slope, m, v in zip(numbers, slopes_w + slopes_b, first, second, strict=True):
            m += 0.1 * (slope - m)
            v += 0.001 * (slope**2 - v)
            each -= rate * (m / (1 - 0.9 ** (step + 1))) / (np.sqrt(v / (1 - 0.999 ** (step + 1))) + 1e-8)
    network = Network(middle=middle, spread=spread, layers=list(zip(weights, offsets, strict=True)))
    off = answer_of(lesson.facts, network) - lesson.worth
    print(f"{len(off):,} cells, root mean square error {np.sqrt((off**2).mean()):.4f}, of {lesson.worth.std():.4f}")
    return network


def known_network(name: str) -> Network:
    """The network that is used so far."""
    middle, spread, layers = read_weights(name)
    return Network(middle=middle, spread=spread, layers=list(layers))


def format_weights(name: str, network: Network) -> str:
    """A table of crown_weights.toml."""

    def numbers(values: Array) -> str:
        return "[" + ", ".join(f"{value:.3g}" for value in values.tolist()) + "]"

    text = f"\n[{name}]\nmiddle = {numbers(network.middle)}\nspread = {numbers(network.spread)}\n"
    for matrix, offset in network.layers:
        rows = "\n".join(f"  {numbers(each)}," for each in matrix)
        text += f"\n[[{name}.layers]]\noffset = {numbers(offset)}\nmatrix = [\n{rows}\n]\n"
    return text


def main() -> int:
    """Learn, and write the weights."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--forests", type=int, default=32)
    parser.add_argument("--only", choices=["photo", "canopy"], help="the other one's weights stay as they are")
    parser.add_argument("-o", "--output", type=Path, default=OUTPUT)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    pictures: dict[str, list[tuple[Raster, Array, float]]] = {"photo": [], "canopy": []}
    with tempfile.TemporaryDirectory() as scratch:
        for number in range(options.forests):
            scene = random_scene(options.seed + number)
            folder = Path(scratch) / scene.name
            make(scene, folder)
            trees = np.loadtxt(folder / "truth" / "trees.csv", ndmin=2)
            pictures["photo"].append((read_photo(folder), trees, scene.sun_deg[0]))
            pictures["canopy"].append((read_canopy(folder, rng), trees, 0.0))
    count = sum(len(trees) for _photo, trees, _sun in pictures["photo"])
    print(f"{options.forests} forests, {count:,} trees", flush=True)
    text = "# Written by tools/learn_crowns.py.\n"
    for name, forests in pictures.items():
        if options.only not in (None, name):
            text += format_weights(name, known_network(name))
            continue
        network, lessons = None, []
        for _turn in range(TURNS):
            lessons += [learn_from(picture, trees, sun, rng, network) for picture, trees, sun in forests]
            facts, worth = (np.concatenate([getattr(each, key) for each in lessons]) for key in ("facts", "worth"))
            network = fit_network(Lesson(facts=facts, worth=worth), rng)
        text += format_weights(name, network)
    options.output.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
