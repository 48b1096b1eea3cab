"""A zip and ground truth, to one confusion matrix a frame or to everything that is wrong."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from math import prod
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from evaluator import compiled, mistakes
from evaluator.archive import Archive, Member, shown
from evaluator.benchmark import DEFAULT_ENCODING, INVALID, LOW_BITS, Benchmark, Track
from evaluator.buffer import Buffer
from evaluator.confusion import VALUES, Runs, count_cloud, count_image, fold
from evaluator.errors import Code, Problem, Refused
from evaluator.frames import Frame
from evaluator.labels import (
    HEADER_BYTES,
    MAX_PIXELS,
    check_cloud_size,
    check_image_start,
    member_limit,
    read_cloud,
    read_image,
)
from evaluator.matching import Matched, match, match_unknown

Progress = Callable[[int, int], None]
Pair = tuple[Frame, Member]
PART = 8
"""Frames that a thread takes at once."""

LISTED = 100
"""Problems that a report lists; all are counted."""


class Truth(Protocol):
    """Where the true labels of a frame come from."""

    def runs(self, track: Track, frame: Frame) -> Runs:
        """The true labels of a frame, as runs of matrix rows."""


NOISY = 7
"""A PNG that takes more than a byte for so many pixels is counted as noise."""


@dataclass(frozen=True)
class Memory:
    """What a thread uses again for frame after frame: for labels, and for what kernels need beside them."""

    labels: Buffer
    spare: Buffer


@dataclass(frozen=True)
class Task:
    """What a submission is checked against: its track, the encoding that it names, and the benchmark of both."""

    benchmark: Benchmark
    track: Track
    encoding: str = DEFAULT_ENCODING


@dataclass(frozen=True)
class Chunk:
    """The outcome of some frames in a row.

    Attributes:
        frames: names of the frames that were counted, N of them.
        confusion: their matrices, shape (N, K, K + 1).
        seen: how often each value occurred in the frames that could be read, shape (256,).
        problems: what is wrong with the others.
    """

    frames: tuple[str, ...]
    confusion: NDArray[np.int64]
    seen: NDArray[np.int64]
    problems: tuple[Problem, ...]


@dataclass(frozen=True)
class Outcome:
    """What became of a whole submission; it is refused when there is any problem."""

    frames: tuple[str, ...]
    confusion: NDArray[np.int64] = field(repr=False)
    problems: tuple[Problem, ...]
    warnings: tuple[Problem, ...]

    @property
    def valid(self) -> bool:
        """Whether nothing is wrong."""
        return not self.problems


def open_archive(path: Path, benchmark: Benchmark) -> Archive:
    """Open a submitted zip under the benchmark's limits.

    Raises:
        Refused: the archive as a whole breaks a rule.
    """
    return Archive(path, max_members=benchmark.limits.max_members)


def plan(archive: Archive, frames: Sequence[Frame] | None, task: Task) -> Matched:
    """Pair the members of an archive with frames; with every file of the right type when no frames are known."""
    if frames is None:
        return match_unknown(archive.members, task.track)
    return match(archive.members, frames, task.track, task.benchmark)


def score_chunk(
    archive: Archive, pairs: Sequence[Pair], task: Task, truth: Truth | None = None, memory: Memory | None = None
) -> Chunk:
    """Read some members and count them against the truth, or only check them when there is none.

    Args:
        archive: the opened submission.
        pairs: which frames, and their members.
        task: what they are checked against.
        truth: the true labels; None to check without scoring.
        memory: to use again; not to be shared between threads.
    """
    columns = task.benchmark.columns(task.encoding)
    memory = memory or Memory(Buffer(), Buffer())
    names, counted, problems = [], [], []
    seen = np.zeros(VALUES, np.int64)
    for frame, member in pairs:
        try:
            counts = _count(archive, frame, member, task, truth, memory)
            values = counts.sum(axis=0)
            seen += values
            if values[columns == INVALID].any():
                raise _out_of_range(shown(member.name), _wrong(values, columns), task)
        except Refused as refused:
            problems.append(refused.problem)
            continue
        if truth:
            names.append(frame.name)
            counted.append(counts)
    confusion = fold(np.stack(counted), columns) if counted else _no_matrices(task)
    return Chunk(tuple(names), confusion, seen, tuple(problems))


def in_parts(pairs: Sequence[Pair], size: int) -> Iterator[Sequence[Pair]]:
    """Cut pairs into parts of a size, in their order; the last may be smaller."""
    return (pairs[start : start + size] for start in range(0, len(pairs), size))


def score_parts(
    archive: Archive, parts: Sequence[Sequence[Pair]], task: Task, truth: Truth | None, *, jobs: int
) -> Iterator[Chunk]:
    """Score parts of an archive in threads; chunks come in the order of their parts, whatever the number of jobs."""
    compiled.load(sum(prod(frame.shape) for part in parts for frame, _ in part))
    mine = threading.local()

    def run(part: Sequence[Pair]) -> Chunk:
        if not hasattr(mine, "memory"):
            mine.memory = Memory(Buffer(), Buffer())
        return score_chunk(archive, part, task, truth, mine.memory)

    if jobs <= 1:
        yield from map(run, parts)
        return
    with ThreadPoolExecutor(jobs) as pool:
        try:
            yield from pool.map(run, parts)
        finally:
            pool.shutdown(cancel_futures=True)


def conclude(matched: Matched, chunks: Sequence[Chunk], task: Task) -> Outcome:
    """Put chunks together, in their order, and explain what their values give away."""
    seen = np.sum([chunk.seen for chunk in chunks], axis=0) if chunks else np.zeros(VALUES, np.int64)
    found = [*matched.problems, *(problem for chunk in chunks for problem in chunk.problems)]
    odd = mistakes.other_encoding(seen, task.track, task.encoding, task.benchmark)
    return Outcome(
        frames=tuple(name for chunk in chunks for name in chunk.frames),
        confusion=np.concatenate([_no_matrices(task), *(chunk.confusion for chunk in chunks)]),
        problems=mistakes.explain(found, seen, task.track, task.encoding, task.benchmark),
        warnings=(*odd, *matched.warnings),
    )


def refusal(problem: Problem, task: Task) -> Outcome:
    """The outcome of an archive that was refused as a whole."""
    return Outcome((), _no_matrices(task), (problem,), ())


def evaluate(  # noqa: PLR0913 each is an option of the command
    path: Path,
    task: Task,
    frames: Sequence[Frame] | None,
    truth: Truth | None = None,
    *,
    jobs: int = 1,
    progress: Progress | None = None,
) -> Outcome:
    """Check a submission and, where there is truth, score it; the result does not depend on `jobs`.

    Args:
        path: the zip.
        task: what it is checked against.
        frames: the frames of the track; None when they are not known.
        truth: their labels; None to check without scoring.
        jobs: how many threads read and count.
        progress: called with the frames done and the frames in all.
    """
    task.benchmark.columns(task.encoding)  # an unknown encoding is the caller's mistake, not the archive's
    try:
        archive = open_archive(path, task.benchmark)
    except Refused as refused:
        return refusal(refused.problem, task)
    with archive:
        matched = plan(archive, frames, task)
        parts = list(in_parts(matched.pairs, max(1, min(PART, len(matched.pairs) // max(1, jobs)))))
        chunks, done = [], 0
        for part, chunk in zip(parts, score_parts(archive, parts, task, truth, jobs=jobs), strict=True):
            chunks.append(chunk)
            done += len(part)
            if progress:
                progress(done, len(matched.pairs))
    outcome = conclude(matched, chunks, task)
    if frames is None:
        note = Problem(Code.CHECKED_WITHOUT_FACTS)
        return Outcome(outcome.frames, outcome.confusion, outcome.problems, (note, *outcome.warnings))
    return outcome


def _count(  # noqa: PLR0913 a frame's whole context
    archive: Archive, frame: Frame, member: Member, task: Task, truth: Truth | None, memory: Memory
) -> NDArray[np.int64]:
    """How often each value of a member meets each true row, shape (K + 1, 256)."""
    name, shape, k = shown(member.name), frame.shape or None, task.benchmark.k
    limit = member_limit(shape) if shape else 4 * MAX_PIXELS
    if task.track.modality.kind == "image":
        if member.size > limit:  # say what it is, without reading it whole
            check_image_start(archive.start(member, HEADER_BYTES), name, shape)
        data = archive.read(member, limit)
        size = read_image(data, name, shape, memory.labels).size
        runs = truth.runs(task.track, frame) if truth else Runs.of_nothing(size)
        noisy = NOISY * len(data) > size
        return count_image(runs, memory.labels, size, k, noisy=noisy, spare=memory.spare)
    check_cloud_size(member.size, name, shape)
    points = read_cloud(archive.read(member, limit), name, shape)
    runs = truth.runs(task.track, frame) if truth else Runs.of_nothing(points.size)
    counts = count_cloud(runs, points, k, spare=memory.spare)
    if counts is None:
        wrong = _wrong(np.bincount(points & LOW_BITS), task.benchmark.columns(task.encoding))
        raise _out_of_range(name, wrong, task)
    return counts


def _no_matrices(task: Task) -> NDArray[np.int64]:
    return np.zeros((0, task.benchmark.k, task.benchmark.k + 1), np.int64)


def _wrong(values: NDArray[np.int64], columns: NDArray[np.uint8]) -> dict[int, int]:
    """How often each value occurs that the encoding does not have."""
    used = np.flatnonzero(values).tolist()
    return {value: int(values[value]) for value in used if value >= VALUES or columns[value] == INVALID}


def _out_of_range(member: str, wrong: dict[int, int], task: Task) -> Refused:
    top = len(task.benchmark.encodings[task.encoding].values) - 1
    listed = [f"{value} ({count} times)" for value, count in list(wrong.items())[:8]]
    more = [f"and {len(wrong) - 8} more values"] if len(wrong) > 8 else []  # noqa: PLR2004 as many as fit a line
    return Refused(
        Problem(Code.VALUE_OUT_OF_RANGE, member, f"{task.encoding} labels 0-{top} or 255", ", ".join(listed + more))
    )
