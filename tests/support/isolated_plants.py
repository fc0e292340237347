"""Clouds of plants whose parts are known: on floors, in pots, with what captures come with."""

from dataclasses import dataclass, field

import numpy as np

LEAF, BARK, POT, CLOTH, SOIL = (60, 140, 40), (96, 74, 58), (70, 80, 130), (90, 88, 86), (70, 50, 36)


@dataclass
class Scene:
    """Points by what they are of."""

    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(7))
    points: list[np.ndarray] = field(default_factory=list)
    colors: list[np.ndarray] = field(default_factory=list)
    names: list[str] = field(default_factory=list)

    def add(self, name: str, points: np.ndarray, color: tuple[int, int, int]) -> None:
        noisy = np.array(color) + self.rng.normal(0, 6, (len(points), 3))
        self.points.append(points)
        self.colors.append(np.clip(noisy, 0, 255).astype(np.uint8))
        self.names += [name] * len(points)

    @property
    def points_m(self) -> np.ndarray:
        return np.concatenate(self.points)

    @property
    def srgb(self) -> np.ndarray:
        return np.concatenate(self.colors)

    def of(self, name: str) -> np.ndarray:
        return np.array(self.names) == name

    # shapes, all about the origin of the floor

    def floor(self, half_m: float, count: int = 60_000, color=CLOTH, noise_m: float = 0.003) -> None:
        places = self.rng.uniform(-half_m, half_m, (count, 2))
        self.add("floor", np.insert(places, 1, self.rng.normal(0, noise_m, count), axis=1), color)

    def shell(self, middle_m, radius_m: float, count: int = 20_000, color=LEAF, name: str = "plant") -> None:
        toward = self.rng.normal(size=(count, 3))
        toward /= np.linalg.norm(toward, axis=1, keepdims=True)
        away_m = radius_m * self.rng.uniform(0.8, 1, (count, 1))
        self.add(name, np.array(middle_m) + toward * away_m, color)

    def tube(self, name: str, radius_m: float, low_m: float, high_m: float, color, count: int = 8000) -> None:
        turn = self.rng.uniform(0, 2 * np.pi, count)
        height_m = self.rng.uniform(low_m, high_m, count)
        self.add(name, np.column_stack([radius_m * np.cos(turn), height_m, radius_m * np.sin(turn)]), color)

    def disk(self, name: str, radius_m: float, height_m: float, color, count: int = 3000) -> None:
        turn, away_m = self.rng.uniform(0, 2 * np.pi, count), radius_m * np.sqrt(self.rng.uniform(0, 1, count))
        place = [away_m * np.cos(turn), np.full(count, height_m), away_m * np.sin(turn)]
        self.add(name, np.column_stack(place), color)

    def turned(self, tilt_rad: float) -> np.ndarray:
        """The points, turned about the x axis: as where up is known roughly."""
        return self.points_m @ tilt(tilt_rad).T


def tilt(angle_rad: float) -> np.ndarray:
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]])


def ring_of_cameras(aim_m, distance_m: float, count: int = 16) -> tuple[np.ndarray, np.ndarray]:
    """Places and axes of cameras around, looking down a little."""
    turn = np.arange(count) * 2 * np.pi / count
    away = np.column_stack([np.cos(turn), np.full(count, 0.5), np.sin(turn)])
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    return np.array(aim_m) + distance_m * away, -away


def potted_plant() -> Scene:
    """A ball of leaves on stems in a pot on a floor, its reflections below, and outliers behind."""
    scene = Scene()
    scene.floor(1.6)
    scene.tube("pot", 0.09, 0.005, 0.18, POT, 12_000)
    scene.disk("soil", 0.085, 0.165, SOIL)
    for x, z in ((0.02, 0.01), (-0.03, 0.02), (0.0, -0.03)):
        scene.tube("plant", 0.006, 0.165, 0.42, LEAF, 900)
        scene.points[-1] = scene.points[-1] + (x, 0, z)
    scene.shell((0, 0.5, 0), 0.16)
    scene.shell((0, -0.2, 0), 0.12, 900, POT, "reflections")
    for k in range(6):
        turn = 1 + k
        scene.shell((1.2 * np.cos(turn), 0.3 + 0.05 * k, 1.2 * np.sin(turn)), 0.03, 300, CLOTH, "outliers")
    return scene
