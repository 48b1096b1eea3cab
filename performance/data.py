"""Synthetic label maps and clouds that cost as much as real ones: about 75 KB a PNG, 25,000 runs of truth a frame."""

from __future__ import annotations

import csv
import io
import json
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from evaluator.benchmark import UNLABELLED, Benchmark
from evaluator.build import build
from evaluator.groundtruth import GroundTruth

HEIGHT, WIDTH, POINTS = 1512, 2016, 86_000
WRONG, SPECKLE = 0.2, 0.1
"""Shares of a cloud's points that are predicted wrong, in runs and one by one."""

DISTINCT = 12
"""Scenes that are drawn; more frames are these, shifted."""

_LIKELY = np.array([-0.05, 0.25, -0.5, 0.3, -0.45, -0.35, -0.5, -0.5, -0.6, -0.5, 0.2, -0.4, 0.6, 0.3, -0.4])
_TRUTH = {500: 0.5, 160: 0.3, 60: 0.15, 20: 0.07, 10: 0.015}
_PREDICTION = {400: 0.5, 120: 0.35, 40: 0.2, 12: 0.052, 5: 0.011}


def scene(seed: int, scales: dict[int, float]) -> NDArray[np.uint8]:
    """A label map of 15 classes whose borders are ragged at several scales, shape (HEIGHT, WIDTH)."""
    rng = np.random.default_rng(seed)
    best = np.full((HEIGHT, WIDTH), -np.inf, np.float32)
    labels = np.zeros((HEIGHT, WIDTH), np.uint8)
    for index, likely in enumerate(_LIKELY):
        height = np.full((HEIGHT, WIDTH), likely, np.float32)
        for scale, weight in scales.items():
            coarse = rng.standard_normal((HEIGHT // scale + 2, WIDTH // scale + 2)).astype(np.float32)
            height += weight * np.asarray(Image.fromarray(coarse).resize((WIDTH, HEIGHT), Image.Resampling.BILINEAR))
        higher = height > best
        best[higher], labels[higher] = height[higher], index
    return labels


def cloud(seed: int, *, truth: bool) -> NDArray[np.uint32]:
    """Labels of a cloud in scan order, runs of about ten points, shape (POINTS,)."""
    rng = np.random.default_rng(seed)
    classes = np.array([0, 1, 2, 3, 4, 5, 6, 7, 9, 11, 12, 13])
    runs = rng.choice(classes, POINTS // 8, p=_shares(_LIKELY[classes]))
    labels = np.repeat(runs, rng.geometric(0.1, runs.size))[:POINTS]
    labels = np.pad(labels, (0, POINTS - labels.size), mode="edge").astype(np.uint32)
    if not truth:
        wrong = np.repeat(rng.random(POINTS // 10) < WRONG, 10)
        labels[wrong] = np.roll(labels, 700)[wrong]
        alone = rng.random(POINTS) < SPECKLE
        labels[alone] = np.roll(labels, 331)[alone]
    return labels


def _shares(likely: NDArray[np.float64]) -> NDArray[np.float64]:
    raised = np.exp(3 * likely)
    shares: NDArray[np.float64] = raised / raised.sum()
    return shares


def png(labels: NDArray[np.uint8]) -> bytes:
    """A label map as Pillow writes it."""
    stream = io.BytesIO()
    Image.fromarray(labels).save(stream, "PNG")
    return stream.getvalue()


def make_truth(folder: Path, benchmark: Benchmark, modality: str, frames: int) -> GroundTruth:
    """A data set of so many test frames, packed; its files stay in `folder/data` for the peers."""
    root, splits = folder / "data", folder / "splits" / benchmark.modalities[modality].splits
    splits.mkdir(parents=True)
    (root / "labels" / "K-01").mkdir(parents=True)
    (root / "dataset.json").write_text(json.dumps({"title": "performance", "synthetic": True}), "utf-8")
    suffix = benchmark.modalities[modality].suffix
    raw = _to_released(benchmark, modality)
    with (splits / "test.csv").open("w", encoding="utf-8", newline="") as stream:
        table = csv.writer(stream)
        table.writerow(["id", "label_path"])
        for name, data in _frames(frames, lambda seed: _truth_file(seed, modality, raw)):
            path = f"labels/K-01/{name}{suffix}"
            (root / path).write_bytes(data)
            table.writerow([name, path])
    build(root, folder / "splits", folder / "packed", benchmark, allow_absent=True)
    return GroundTruth(folder / "packed", benchmark)


def make_zip(path: Path, modality: str, frames: int, *, noise: bool = False) -> Path:
    """Predictions for `make_truth`'s frames, as one zip."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in _frames(frames, lambda seed: _prediction_file(seed, modality, noise=noise)):
            archive.writestr(f"{name}.png" if modality == "2d" else f"{name}.label", data)
    return path


def _frames(frames: int, draw: Callable[[int], bytes]) -> Iterator[tuple[str, bytes]]:
    drawn = [draw(seed) for seed in range(min(frames, DISTINCT))]
    return ((f"{1_600_000_000 + i}-{i:09}", drawn[i % len(drawn)]) for i in range(frames))


def _truth_file(seed: int, modality: str, raw: NDArray[np.uint8]) -> bytes:
    return png(raw[scene(seed, _TRUTH)]) if modality == "2d" else cloud(seed, truth=True).tobytes()


def _prediction_file(seed: int, modality: str, *, noise: bool) -> bytes:
    if modality == "3d":
        return cloud(seed, truth=False).tobytes()
    if noise:
        return png(np.random.default_rng(seed).integers(0, 15, (HEIGHT, WIDTH), np.uint8))
    return png(scene(seed, _PREDICTION))


def _to_released(benchmark: Benchmark, modality: str) -> NDArray[np.uint8]:
    """From canonical classes to the encoding of the modality's released labels."""
    values = benchmark.encodings[benchmark.modalities[modality].groundtruth_encoding].values
    raw = np.full(256, UNLABELLED, np.uint8)
    for index, name in enumerate(benchmark.names):
        raw[index] = values.index(name)
    return raw
