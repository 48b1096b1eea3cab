"""Likely mistakes, told from which values a whole submission holds."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evaluator.benchmark import DEFAULT_ENCODING, UNLABELLED, Benchmark, Track
from evaluator.errors import Code, Problem


def other_encoding(seen: NDArray[np.int64], track: Track, encoding: str, benchmark: Benchmark) -> tuple[Problem, ...]:
    """Warn of labels that are legal in the named encoding, but look as if they were in another one.

    A suspect with fewer indices is likely when its first index that means another class occurs, and the first index
    that it does not have never does.

    Args:
        seen: how often each value occurs in the submission, shape (256,).
        track: its track, whose modality names the suspects.
        encoding: the encoding that it was submitted under.
        benchmark: which defines the encodings.
    """
    named, warnings = benchmark.encodings[encoding].values, []
    for suspect in track.modality.suspects:
        values = benchmark.encodings[suspect].values
        differing = [i for i, (a, b) in enumerate(zip(values, named, strict=False)) if a != b]
        if suspect == encoding or not differing or len(values) >= len(named):
            continue
        first = differing[0]
        if seen[first] and not seen[len(values)]:
            hint = (
                f"These labels look like {suspect!r}, in which {first} is {values[first]} and not {named[first]}. "
                f"If so, send them again with labels={suspect}."
            )
            found = f"{first} occurs, {len(values)} never"
            warnings.append(Problem(Code.LOOKS_LIKE_OTHER_ENCODING, None, encoding, found, hint))
    return tuple(warnings)


def explain(
    problems: Iterable[Problem], seen: NDArray[np.int64], track: Track, encoding: str, benchmark: Benchmark
) -> tuple[Problem, ...]:
    """Give values out of range a hint that names the likely mistake, where there is one."""
    hint = _range_hint(seen, track, encoding, benchmark)
    return tuple(
        replace(one, hint=hint) if hint and one.code is Code.VALUE_OUT_OF_RANGE and one.hint is None else one
        for one in problems
    )


def _range_hint(seen: NDArray[np.int64], track: Track, encoding: str, benchmark: Benchmark) -> str | None:
    used = np.flatnonzero(seen[:UNLABELLED])
    size = len(benchmark.encodings[encoding].values)
    if not used.size or used[-1] < size:
        return None
    if encoding == DEFAULT_ENCODING and used[-1] == size:
        return "0 seems to be 'unlabelled' here and every index one too high: subtract 1, and write 255 where it was 0."
    for suspect in (DEFAULT_ENCODING, *track.modality.suspects):
        if suspect in benchmark.encodings and used[-1] < len(benchmark.encodings[suspect].values):
            return f"These labels look like {suspect!r}: send them again with labels={suspect}."
    return None
