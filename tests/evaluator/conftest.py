"""What the evaluator's tests share: label files written byte by byte, and data sets small enough to score at once."""

from __future__ import annotations

import csv
import io
import os
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import settings
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from evaluator import compiled
from evaluator.benchmark import Benchmark, load
from evaluator.build import build
from evaluator.demo import write_demo
from evaluator.evaluate import Outcome, Task, evaluate
from evaluator.groundtruth import GroundTruth

Frames = dict[tuple[str, str, str, str], ArrayLike]
"""Labels by modality, split, sequence and name, in the modality's own encoding."""

HERE = Path(__file__).resolve().parent

settings.register_profile("evaluator", deadline=None, max_examples=50)
settings.load_profile("evaluator")


class Make:
    """Files as submitters write them, and as they should not."""

    @staticmethod
    def chunk(kind: bytes, body: bytes) -> bytes:
        """A chunk of a PNG, its checksum right."""
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    @classmethod
    def raw_png(
        cls,
        size: tuple[int, int],
        pixels: bytes,
        *,
        depth: int = 8,
        colour: int = 0,
        interlaced: bool = False,
        extra: bytes = b"",
    ) -> bytes:
        """A PNG of (width, height) from filtered rows, whatever its header claims; `extra` chunks follow the header."""
        header = struct.pack(">IIBBBBB", *size, depth, colour, 0, 0, int(interlaced))
        palette = cls.chunk(b"PLTE", bytes(range(48))) if colour == 3 else b""
        chunks = [cls.chunk(b"IHDR", header), extra, palette, cls.chunk(b"IDAT", zlib.compress(pixels))]
        return b"\x89PNG\r\n\x1a\n" + b"".join(chunks) + cls.chunk(b"IEND", b"")

    @staticmethod
    def png(labels: ArrayLike, *, bits: int | None = None, mode: str = "L") -> bytes:
        """A PNG as Pillow writes it; with `bits`, a palette of that depth whose indices are the labels."""
        image = Image.fromarray(np.asarray(labels, np.uint8)).convert(mode)
        options = {}
        if bits:
            image = Image.frombytes("P", image.size, np.asarray(labels, np.uint8).tobytes())
            image.putpalette([(37 * i) % 256 for i in range(3 * 2**bits)])
            options["bits"] = bits
        buffer = io.BytesIO()
        image.save(buffer, "PNG", **options)
        return buffer.getvalue()

    @staticmethod
    def cloud(labels: ArrayLike) -> bytes:
        """A SemanticKITTI label file."""
        return np.asarray(labels, "<u4").tobytes()

    @classmethod
    def labels(cls, labels: ArrayLike, kind: str) -> bytes:
        """The file of an image or a cloud."""
        return cls.png(labels) if kind == "image" else cls.cloud(labels)

    @staticmethod
    def zip(
        path: Path,
        members: dict[str, bytes] | Iterable[tuple[str | zipfile.ZipInfo, bytes]],
        compression: int = zipfile.ZIP_DEFLATED,
    ) -> Path:
        """An archive of members, a mapping or pairs of names (or ZipInfos) and bytes, in this order."""
        pairs = members.items() if isinstance(members, dict) else members
        with zipfile.ZipFile(path, "w", compression) as archive:
            for name, data in pairs:
                archive.writestr(name, data)
        return path


@dataclass(frozen=True)
class Planted:
    """A data set, its packed release, and how to submit to it."""

    benchmark: Benchmark
    data: Path
    splits: Path
    truth: GroundTruth

    def task(self, track_id: str, encoding: str = "benchmark") -> Task:
        """What a submission to a track is checked against."""
        return Task(self.benchmark, self.benchmark.track(track_id), encoding)

    def rows(self, track_id: str) -> Iterator[tuple[str, str, Path]]:
        """The lines of the track's split file with the sequence of each, in the file's order."""
        track = self.benchmark.track(track_id)
        file = self.splits / track.modality.splits / f"{track.protocol.split}.csv"
        with file.open(newline="", encoding="utf-8") as stream:
            for row in csv.DictReader(stream):
                for sequence in set(Path(row["label_path"]).parts) & set(track.protocol.test_sequences):
                    yield sequence, row["id"], self.data / row["label_path"]

    def answers(self, track_id: str) -> dict[tuple[str, str], NDArray[np.uint8]]:
        """The track's true labels, read without the evaluator: {(sequence, frame): canonical labels}."""
        track = self.benchmark.track(track_id)
        names = (*self.benchmark.names, "unlabelled")
        table = np.full(256, 255, np.uint8)
        for value, name in enumerate(self.benchmark.encodings[track.modality.groundtruth_encoding].values):
            if name:
                table[value] = names.index(name) if name != "unlabelled" else 255
        found = {}
        for sequence, frame, path in self.rows(track_id):
            is_image = track.modality.kind == "image"
            found[sequence, frame] = table[
                np.array(Image.open(path)) if is_image else np.fromfile(path, "<u4") & 0xFFFF
            ]
        return found

    def flat(
        self, track_id: str, change: Callable[[NDArray[np.uint8]], NDArray[np.uint8]] = lambda labels: labels
    ) -> dict[str, bytes]:
        """A submission of the true labels, or of what `change` makes of them: {member: bytes}."""
        modality = self.benchmark.track(track_id).modality
        return {
            f"{frame}{modality.suffix}": Make.labels(change(labels), modality.kind)
            for (_, frame), labels in self.answers(track_id).items()
        }

    def score(self, archive: Path, track_id: str, encoding: str = "benchmark", *, jobs: int = 1) -> Outcome:
        """Evaluate an archive."""
        task = self.task(track_id, encoding)
        return evaluate(archive, task, self.truth.frames(task.track), self.truth, jobs=jobs)


def plant(folder: Path, benchmark: Benchmark, frames: Frames) -> Path:
    """Write a data set: {(modality, split, sequence, frame): labels in the modality's own encoding}."""
    rows: dict[tuple[str, str], list[str]] = {}
    for (modality_id, split, sequence, frame), labels in frames.items():
        modality = benchmark.modalities[modality_id]
        path = Path(modality_id, sequence, frame + modality.suffix)
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(Make.labels(labels, modality.kind))
        rows.setdefault((modality.splits, split), []).append(f"{frame},{path.as_posix()}")
    for (splits, split), listed in rows.items():
        file = folder / "splits" / splits / f"{split}.csv"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("\n".join(["id,label_path", *listed, ""]), "utf-8")
    return folder


def pack(benchmark: Benchmark, data: Path, out: Path, **options: Any) -> Planted:
    """A planted data set with its release."""
    build(data, data / "splits", out, benchmark, **options)
    return Planted(benchmark, data, data / "splits", GroundTruth(out, benchmark))


@pytest.fixture(scope="module", params=["compiled", "plain"])
def either_path(request: pytest.FixtureRequest) -> Iterator[str]:
    """Run a module's tests with the extra `fast` and without it."""
    before = os.environ.get(compiled.PLAIN)
    if request.param == "compiled" and (before or find_spec("numba") is None or find_spec("deflate") is None):
        pytest.skip("the extra `fast` is not installed, or not wanted here")
    if request.param == "plain":
        os.environ[compiled.PLAIN] = "1"
    compiled.forget()
    compiled.load()
    yield request.param
    os.environ.pop(compiled.PLAIN, None)
    if before:
        os.environ[compiled.PLAIN] = before
    compiled.forget()


@pytest.fixture(scope="session")
def make() -> type[Make]:
    return Make


@pytest.fixture(scope="session")
def planting() -> Callable[..., Path]:
    return plant


@pytest.fixture(scope="session")
def packing() -> Callable[..., Planted]:
    return pack


@pytest.fixture(scope="session")
def wildscenes() -> Benchmark:
    return load()


@pytest.fixture(scope="session")
def forest() -> Benchmark:
    return load(HERE / "forest.toml")


@pytest.fixture(scope="session")
def demo(tmp_path_factory: pytest.TempPathFactory, wildscenes: Benchmark) -> Planted:
    folder = tmp_path_factory.mktemp("demo")
    write_demo(folder / "data", frames=2, size=(64, 48), points=300)
    return pack(wildscenes, folder / "data", folder / "release")


FOREST_FRAMES: Frames = {
    ("photo", "train", "North", "1-000000001"): [[1, 1, 1, 0], [3, 0, 0, 0]],
    ("photo", "val", "North", "2-000000001"): [[1, 1, 3, 3], [0, 0, 1, 1]],
    ("photo", "test", "North", "3-000000001"): [[1, 3, 4, 0], [1, 3, 4, 4]],
    ("photo", "test", "South", "4-000000001"): [[1, 1, 1, 1], [3, 3, 4, 255]],
    ("scan", "test", "North", "3-000000001"): [0, 1, 2, 255, 0, 1],
    ("scan", "test", "South", "4-000000001"): [0, 0, 1, 1, 2],
}
"""Photos of 4x2 pixels in the encoding `ids`, scans of 6 and 5 points in canonical indices."""


@pytest.fixture
def forest_frames() -> Frames:
    return dict(FOREST_FRAMES)


@pytest.fixture(scope="session")
def small(tmp_path_factory: pytest.TempPathFactory, forest: Benchmark) -> Planted:
    folder = tmp_path_factory.mktemp("forest")
    return pack(forest, plant(folder / "data", forest, FOREST_FRAMES), folder / "release")


@pytest.fixture(scope="session")
def shared() -> Path:
    folder = HERE.parents[1].parent / "shared"
    if not folder.is_dir():
        pytest.skip(f"the paper's tables, split files and the real frame are not here: no folder {folder}")
    return folder
