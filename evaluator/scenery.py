"""Invented forests: label maps of the demo, drawn from random numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from evaluator.benchmark import UNLABELLED

if TYPE_CHECKING:
    from numpy.typing import NDArray

COMMON = ("bush", "dirt", "grass", "sky", "tree-foliage", "tree-trunk")
"""Classes of every frame."""

RARE = ("fence", "gravel", "log", "mud", "other-object", "other-terrain", "rock", "structure", "water")
"""Classes that the frames of a sequence share out."""

UNSEEN_IN_CLOUDS = ("sky", "water")


def draw_scene(
    rng: np.random.Generator, size: tuple[int, int], names: tuple[str, ...], rare: set[str]
) -> NDArray[np.uint8]:
    """A forest as canonical labels, shape (H, W), with every common class and these rare ones, perhaps more."""
    width, height = size
    y, x = np.mgrid[0.5:height, 0.5:width] / np.array([[[height]], [[width]]])
    canvas = _Canvas(np.full((height, width), names.index("tree-foliage"), np.uint8), names, rng, x, y)
    shown = {name for name in RARE if name in rare or rng.random() < 0.12}
    horizon = rng.uniform(0.5, 0.6)
    _paint_backdrop(canvas, horizon, shown)
    _paint_ground(canvas, horizon, shown)
    _paint_trunks(canvas, horizon)
    if "other-object" in shown:  # a sign
        left, foot = rng.uniform(0.1, 0.8), horizon + rng.uniform(0.12, 0.25)
        canvas.paint("other-object", (abs(x - left - 0.05) < 0.008) & (abs(y - foot + 0.12) < 0.12))
        canvas.paint("other-object", (abs(x - left - 0.05) < 0.05) & (abs(y - foot + 0.22) < 0.05))
    canvas.labels[canvas.noise(9, 12) > 0.84] = UNLABELLED
    _ensure(canvas.labels, [*(names.index(name) for name in (*COMMON, *sorted(rare))), UNLABELLED], rng)
    return canvas.labels


def _paint_backdrop(canvas: _Canvas, horizon: float, shown: set[str]) -> None:
    rng, x, y = canvas.rng, canvas.x, canvas.y
    opening = 0.75 - 1.1 * abs(y - 0.12) - 0.35 * abs(x - rng.uniform(0.3, 0.7))
    canvas.paint("sky", (canvas.noise(7, 9) < opening - 0.12) & (y < horizon - 0.1))
    if "structure" in shown:
        middle, half, top = rng.uniform(0.2, 0.8), rng.uniform(0.1, 0.16), horizon - rng.uniform(0.12, 0.2)
        walls = (abs(x - middle) < half) & (y > top) & (y < horizon + 0.06)
        canvas.paint("structure", walls | ((y <= top) & (top - y < 0.1 - 0.6 * abs(x - middle))))
    canvas.paint("bush", (abs(y - horizon) < 0.1) & (canvas.noise(5, 9) > 0.52 + 2 * abs(y - horizon)))


def _paint_ground(canvas: _Canvas, horizon: float, shown: set[str]) -> None:
    rng, x, y = canvas.rng, canvas.x, canvas.y
    ground = y > horizon + 0.14 * (canvas.noise(2, 8) - 0.4)
    canvas.paint("grass", ground)
    depth = np.clip((y - horizon) / (1 - horizon), 0, 1)
    canvas.paint("dirt", ground & (canvas.noise(6, 5) > 0.62))
    path = rng.uniform(0.35, 0.65) + rng.uniform(-0.25, 0.25) * depth**2 + 0.1 * (canvas.noise(4, 1) - 0.5)
    canvas.paint("dirt", ground & (abs(x - path) < 0.03 + 0.2 * depth + 0.08 * (canvas.noise(8, 8) - 0.5)))
    for name in sorted(shown & {"gravel", "mud", "other-terrain", "rock", "water"}):
        middle, low = rng.uniform(0.1, 0.9), rng.uniform(horizon + 0.12, 0.94)
        wide = rng.uniform(0.25, 0.4) * (low - horizon) + 0.04
        flat = 0.8 if name == "rock" else 0.35
        distance = ((x - middle) / wide) ** 2 + ((y - low) / (wide * flat)) ** 2
        canvas.paint(name, ground & (distance < 0.4 + 1.2 * canvas.noise(10, 10)))
    if "fence" in shown:
        rail = y - horizon - 0.04 * x
        posts = (np.mod(x, 0.09) < 0.014) & (abs(rail) < 0.07)
        canvas.paint("fence", posts | (abs(rail + 0.04) < 0.01) | (abs(rail - 0.015) < 0.01))
    if "log" in shown:
        slope, middle, low = rng.uniform(-0.35, 0.35), rng.uniform(0.2, 0.8), rng.uniform(horizon + 0.15, 0.92)
        wobble = 0.03 * (canvas.noise(2, 8) - 0.5)
        canvas.paint("log", (abs(x - middle) < 0.16) & (abs(y - low - slope * (x - middle) + wobble) < 0.026))


def _paint_trunks(canvas: _Canvas, horizon: float) -> None:
    """Trunks from far and thin to near and thick, then leaves in front of them."""
    rng, x, y = canvas.rng, canvas.x, canvas.y
    for near in np.sort(rng.random(int(rng.integers(6, 12))) ** 2):
        foot = horizon + 0.02 + 0.32 * near
        middle = rng.uniform(0, 1) + rng.uniform(-0.08, 0.08) * (foot - y) + 0.05 * (canvas.noise(4, 1) - 0.5)
        half = (0.007 + 0.03 * near) * (0.75 + 0.35 * y / foot)
        canvas.paint("tree-trunk", (abs(x - middle) < half) & (y < foot) & (y > 0.3 - 0.4 * near))
    canvas.paint("tree-foliage", (canvas.noise(9, 12) > 0.5 + 0.5 * y) & (y < horizon - 0.05))


def draw_cloud(
    rng: np.random.Generator, scene: NDArray[np.uint8], names: tuple[str, ...], rare: set[str], points: int
) -> NDArray[np.uint8]:
    """The labels of points that see the scene, column by column as a sweep does, shape (N,)."""
    unseen = [names.index(name) for name in UNSEEN_IN_CLOUDS]
    solid = scene.T[~np.isin(scene.T, unseen)]
    labels: NDArray[np.uint8] = solid[np.sort(rng.integers(0, solid.size, points - int(rng.integers(0, points // 10))))]
    seen = {*(names.index(name) for name in (*COMMON, *rare)), UNLABELLED} - set(unseen)
    _ensure(labels, sorted(seen), rng)
    return labels


def _ensure(labels: NDArray[np.uint8], wanted: list[int], rng: np.random.Generator) -> None:
    """Put a speck of each missing value where the commonest one is: that one is never used up."""
    common = np.bincount(labels.ravel()).argmax()
    for value in wanted:
        if not (labels == value).any():
            spot = rng.choice(np.argwhere(labels == common))
            speck = labels[tuple(slice(i, i + max(2, n // 40)) for i, n in zip(spot, labels.shape, strict=True))]
            speck[speck == common] = value


@dataclass(frozen=True)
class _Canvas:
    """A label map under work; x and y run over 0..1 from the top left."""

    labels: NDArray[np.uint8]
    names: tuple[str, ...]
    rng: np.random.Generator
    x: NDArray[np.float64]
    y: NDArray[np.float64]

    def paint(self, name: str, where: NDArray[np.bool_]) -> None:
        self.labels[where] = self.names.index(name)

    def noise(self, rows: int, columns: int) -> NDArray[np.float64]:
        return value_noise(self.rng, self.labels.shape, (rows, columns))


def value_noise(rng: np.random.Generator, shape: tuple[int, ...], cells: tuple[int, ...]) -> NDArray[np.float64]:
    """Value noise in [0, 1] about 0.5: a random grid with a finer one on top, smoothly joined along each axis."""
    made = np.zeros(shape)
    for weight, finer in ((0.7, 1), (0.3, 3)):
        grid = rng.random([n * finer + 1 for n in cells])
        for axis, (length, n) in enumerate(zip(shape, cells, strict=True)):
            near = np.linspace(0, n * finer, length)[:, None] - np.arange(n * finer + 1)
            near = np.clip(1 - abs(near), 0, 1)
            grid = np.moveaxis(np.tensordot(near * near * (3 - 2 * near), grid, (1, axis)), 0, axis)
        made += weight * grid
    return made
