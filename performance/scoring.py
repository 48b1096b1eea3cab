"""How fast a submission is scored, beside what others do with the same zip; `make bench` writes docs/performance.md.

Every comparison alternates the two (A B A B …) in one process, warm, and prints the ratio of each pair: the median and
the best. Absolute times are this machine's.
"""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from evaluator.benchmark import load
from evaluator.evaluate import Task, evaluate
from performance.data import make_truth, make_zip
from performance.peers import cityscapes_like, decode_members, read_members, semantic_kitti_like, student_script

BENCHMARK = load()
START_SECONDS, ANONYMOUS_MB = 1.2, 400
"""What a start and the full set are held to."""

REPORT = Path(__file__).parents[1] / "docs" / "performance.md"


@dataclass(frozen=True)
class Row:
    """A comparison: ratios of pairs, and what they are held to."""

    what: str
    median: float
    best: float
    bound: str
    kept: bool


class Bench:
    """One modality's zip and truth."""

    def __init__(self, folder: Path, modality: str, frames: int) -> None:
        """Generate the data."""
        self.folder, self.modality, self.frames = folder / modality, modality, frames
        self.folder.mkdir(parents=True)
        self.truth = make_truth(self.folder, BENCHMARK, modality, frames)
        self.labels = self.folder / "data" / "labels" / "K-01"
        self.task = Task(BENCHMARK, BENCHMARK.track(f"{modality}-standard"))
        self.zip = make_zip(self.folder / "predictions.zip", modality, frames)

    def ours(self, archive: Path | None = None, *, jobs: int = 1, frames: int | None = None) -> np.ndarray:
        """Score the zip."""
        wanted = self.truth.frames(self.task.track)[: frames or self.frames]
        outcome = evaluate(archive or self.zip, self.task, wanted, self.truth, jobs=jobs)
        if not outcome.valid:
            raise SystemExit(str(outcome.problems[0]))
        return outcome.confusion


def pairs(first: Callable[[], object], second: Callable[[], object], count: int) -> list[tuple[float, float]]:
    """Seconds of both, alternating, after one warm-up of each."""
    first()
    second()
    return [(_seconds(first), _seconds(second)) for _ in range(count)]


def _seconds(call: Callable[[], object]) -> float:
    begun = time.perf_counter()
    call()
    return time.perf_counter() - begun


def at_most(what: str, measured: list[tuple[float, float]], bound: float) -> Row:
    """A row that says how much of the other's time ours takes."""
    ratios = [ours / other for ours, other in measured]
    median = statistics.median(ratios)
    return Row(what, median, min(ratios), f"<= {bound}", median <= bound)


def times_faster(what: str, measured: list[tuple[float, float]], bound: float) -> Row:
    """A row that says how many times as long the other takes."""
    ratios = [other / ours for ours, other in measured]
    median = statistics.median(ratios)
    return Row(what, median, min(ratios), f">= {bound} x", median >= bound)


def compare(folder: Path, count: int) -> tuple[list[Row], dict[str, float]]:
    """Every comparison, and milliseconds a frame."""
    images, clouds = Bench(folder, "2d", 48), Bench(folder, "3d", 200)
    noise = make_zip(folder / "noise.zip", "2d", 12, noise=True)
    columns = BENCHMARK.columns("raw19")
    table = np.where(columns == BENCHMARK.k, 255, columns).astype(np.uint8)
    expected = images.ours().sum(axis=0)
    np.testing.assert_array_equal(student_script(images.zip, images.labels, table), expected)
    bare = pairs(images.ours, lambda: decode_members(images.zip), count)
    scored = pairs(clouds.ours, lambda: read_members(clouds.zip), count)
    rows = [
        at_most("2D / bare `zipfile.read` + Pillow decode of the prediction", bare, 0.25),
        times_faster(
            "2D, cityscapesScripts-like",
            pairs(images.ours, lambda: cityscapes_like(images.zip, images.labels), count),
            10,
        ),
        times_faster(
            "2D, a student's script",
            pairs(images.ours, lambda: student_script(images.zip, images.labels, table), count),
            20,
        ),
        times_faster(
            "3D, extract + semantic-kitti-api's evaluation",
            pairs(clouds.ours, lambda: semantic_kitti_like(clouds.zip, clouds.labels), count),
            10,
        ),
        at_most("3D / bare `zipfile.read` of all members", scored, 0.5),
        at_most(
            "random-label PNGs / bare Pillow decode",
            pairs(lambda: images.ours(noise, frames=12), lambda: decode_members(noise), count),
            0.8,
        ),
    ]
    alone = {
        "2D": 1e3 * statistics.median(a for a, _ in bare) / images.frames,
        "3D": 1e3 * statistics.median(a for a, _ in scored) / clouds.frames,
    }
    return rows, alone


def threads(folder: Path, count: int) -> list[Row]:
    """Two threads beside one, on zips that are long enough for threads to matter."""
    rows = []
    for modality, frames, bound in (("2d", 400, 1.7), ("3d", 2000, 1.5)):
        bench = Bench(folder / "threads", modality, frames)
        measured = pairs(lambda b=bench: b.ours(jobs=2), lambda b=bench: b.ours(), count)
        np.testing.assert_array_equal(bench.ours(jobs=2), bench.ours())
        rows.append(times_faster(f"two threads, {modality.upper()}, {frames} frames", measured, bound))
    return rows


def anonymous_memory(call: Callable[[], object]) -> float:
    """The most anonymous memory (RssAnon, MB) that this process has while a call runs."""
    peak, over = 0.0, threading.Event()

    def watch() -> None:
        nonlocal peak
        while not over.wait(0.02):
            said = Path("/proc/self/status").read_text("ascii")
            peak = max(peak, int(said.split("RssAnon:")[1].split()[0]) / 1024)

    watcher = threading.Thread(target=watch)
    watcher.start()
    call()
    over.set()
    watcher.join()
    return peak


def full_set(folder: Path, modality: str, frames: int) -> tuple[float, float, float]:
    """Seconds of the whole test set with one thread and with two, and RssAnon in MB; in a process of its own."""
    bench = Bench(folder / "full", modality, frames)
    script = (
        "import sys; sys.path[:0] = [{here!r}]\n"
        "from pathlib import Path\nimport time\nfrom performance import scoring\n"
        "from evaluator.evaluate import Task, evaluate\nfrom evaluator.groundtruth import GroundTruth\n"
        "truth = GroundTruth(Path({packed!r}), scoring.BENCHMARK)\n"
        "task = Task(scoring.BENCHMARK, scoring.BENCHMARK.track({track!r}))\n"
        "run = lambda jobs: evaluate(Path({zip!r}), task, truth.frames(task.track), truth, jobs=jobs)\n"
        "run(2)\nspent = []\n"
        "for jobs in (1, 2):\n    begun = time.perf_counter(); run(jobs); spent.append(time.perf_counter() - begun)\n"
        "print(*spent, scoring.anonymous_memory(lambda: run(2)))\n"
    ).format(
        here=str(Path(__file__).parents[1]),
        packed=str(bench.truth.folder),
        track=f"{modality}-standard",
        zip=str(bench.zip),
    )
    said = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True)  # noqa: S603 ours
    one, two, memory = map(float, said.stdout.split())
    return one, two, memory


def start(folder: Path, count: int) -> float:
    """Seconds of `wildscenes evaluate` on three frames, warm caches: the median of whole processes."""
    bench = Bench(folder / "start", "2d", 3)
    command = [sys.executable, "-m", "evaluator.cli", "evaluate", str(bench.zip), "--track", "2d-standard"]
    command += ["--groundtruth", str(bench.truth.folder)]
    spent = [
        _seconds(lambda: subprocess.run(command, check=True, stdout=subprocess.DEVNULL))  # noqa: S603 ours
        for _ in range(count + 1)
    ]
    return statistics.median(spent[1:])


def main() -> None:
    """Measure, print, and write the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=7, help="pairs of each comparison")
    parser.add_argument("--full", action="store_true", help="the full test sets too (2133 images, 2705 clouds)")
    parser.add_argument("--write", action="store_true", help="write docs/performance.md")
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="wildscenes-performance-"))
    try:
        rows, alone = compare(folder, options.pairs)
        rows += threads(folder, options.pairs)
        begun = start(folder, options.pairs)
        rows.append(
            Row(
                "start of `wildscenes evaluate` on three frames, seconds",
                begun,
                begun,
                f"<= {START_SECONDS}",
                begun <= START_SECONDS,
            )
        )
        full = {}
        if options.full:
            for modality, frames in (("2d", 2133), ("3d", 2705)):
                full[modality] = full_set(folder, modality, frames)
                memory = full[modality][2]
                rows.append(
                    Row(
                        f"RssAnon over the full {modality.upper()} set, MB",
                        memory,
                        memory,
                        f"<= {ANONYMOUS_MB}",
                        memory <= ANONYMOUS_MB,
                    )
                )
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    text = report(rows, alone, full, options.pairs)
    print(text)
    if options.write:
        REPORT.write_text(text, "utf-8")


def row_text(row: Row) -> str:
    """A line of the table."""
    return f"| {row.what} | {row.median:.2f} | {row.best:.2f} | {row.bound} | {'kept' if row.kept else 'MISSED'} |"


def report(rows: list[Row], alone: dict[str, float], full: dict[str, tuple[float, float, float]], count: int) -> str:
    """The table as Markdown."""
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "numba", "deflate", "pillow"))
    lines = [
        "# How fast scoring is",
        "",
        "Made by `make bench`. Each comparison runs both sides on the same zip in one process, alternating, warm, with",
        f"one thread unless it says otherwise; the figure is the median of {count} pairs' ratios, the best pair's",
        "beside it. Label maps are 2016x1512, clouds 86,000 points, both synthetic (`performance/data.py`). Peers are",
        "written from the description of each kit (`performance/peers.py`).",
        "",
        "| what | median | best pair | held to | |",
        "| --- | --- | --- | --- | --- |",
        *(row_text(row) for row in rows),
        "",
        f"One thread takes {alone['2D']:.2f} ms an image and {alone['3D']:.3f} ms a cloud.",
        *(
            f"The full {m.upper()} set takes {one:.1f} s with one thread and {two:.1f} s with two."
            for m, (one, two, _) in full.items()
        ),
        "",
        f"Machine: {platform.machine()}, {os.cpu_count()} cores, {platform.system()}.",
        f"Python {platform.python_version()}, {packages}.",
        "",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
