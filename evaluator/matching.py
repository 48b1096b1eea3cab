"""Which member of an archive is which frame of a track."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from posixpath import splitext

from evaluator.archive import Member, shown
from evaluator.benchmark import Benchmark, Track
from evaluator.errors import Code, Problem
from evaluator.frames import Frame, frame_name

RIVALS = 3
"""Members of one frame that a problem names."""


@dataclass(frozen=True)
class Matched:
    """The frames that have a member, in the frames' order, and what is wrong with the names."""

    pairs: tuple[tuple[Frame, Member], ...]
    problems: tuple[Problem, ...]
    warnings: tuple[Problem, ...]


def match(members: Iterable[Member], frames: Sequence[Frame], track: Track, benchmark: Benchmark) -> Matched:
    """Pair members with frames by file stem; extensions ignore case, `-` and `.` inside a timestamp are the same."""
    wanted = {frame.name: frame for frame in frames}
    sequences = {one.name for one in benchmark.sequences}
    suffix = track.modality.suffix
    claims: dict[str, list[Member]] = {}
    problems: list[Problem] = []
    warnings: list[Problem] = []
    wrong_type: set[str] = set()
    for member in members:
        if member.is_junk:
            continue
        name, extension = _split(member.parts[-1], wanted)
        frame = wanted.get(name)
        if frame is None:
            warnings.append(Problem(Code.UNKNOWN_MEMBER, shown(member.name)))
        elif extension != suffix:
            wrong_type.add(name)
            problems.append(
                Problem(Code.WRONG_TYPE, shown(member.name), f"{name}{suffix}", extension or "a name without extension")
            )
        else:
            claims.setdefault(name, []).append(member)
            named = [part for part in member.parts[:-1] if part in sequences]
            if named and named[-1] != frame.sequence:
                problems.append(Problem(Code.WRONG_SEQUENCE, shown(member.name), frame.sequence, named[-1]))
    for name, rivals in claims.items():
        if len(rivals) > 1:
            more = [f"and {len(rivals) - RIVALS} more"] if len(rivals) > RIVALS else []
            found = ", ".join([*(shown(one.name) for one in rivals[:RIVALS]), *more])
            problems.append(Problem(Code.DUPLICATE_FRAME, shown(rivals[1].name), f"one member for {name}", found))
    if frames and not claims and not wrong_type:
        first = warnings[0].member if warnings else "no file at all"
        wanted_name = f"{frames[0].sequence}/{frames[0].name}{suffix}"
        problems.append(Problem(Code.NO_FRAME_NAMED, None, f"names such as {wanted_name}", first))
    problems += [
        Problem(Code.MISSING_FRAME, f"{frame.sequence}/{frame.name}{suffix}", "a member of this name", "none")
        for frame in frames
        if frame.name not in claims and frame.name not in wrong_type
    ]
    pairs = tuple((frame, claims[frame.name][0]) for frame in frames if frame.name in claims)
    return Matched(pairs, tuple(problems), tuple(warnings))


def match_unknown(members: Iterable[Member], track: Track) -> Matched:
    """Take every file of the track's type for a frame, where no frames are known: shapes are empty then."""
    suffix = track.modality.suffix
    pairs, odd = [], []
    for member in members:
        if member.is_junk:
            continue
        stem, extension = splitext(member.parts[-1])
        if extension.lower() == suffix:
            pairs.append((Frame(name=frame_name(stem), sequence="", split="", shape=()), member))
        else:
            odd.append(Problem(Code.UNKNOWN_MEMBER, shown(member.name)))
    return Matched(tuple(pairs), (), tuple(odd))


def _split(name: str, wanted: dict[str, Frame]) -> tuple[str, str]:
    """A frame's name and the extension; a name such as `1623370893.376340233` has none."""
    whole = frame_name(name)
    if whole in wanted:
        return whole, ""
    stem, extension = splitext(name)
    return frame_name(stem), extension.lower()
