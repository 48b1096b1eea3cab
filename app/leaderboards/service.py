"""Boards: one SELECT, disclosed, ranked."""

from __future__ import annotations

from dataclasses import dataclass, replace

from sqlalchemy import select

from app.accounts.models import Team
from app.errors import NotFound
from app.leaderboards.ranking import Candidate, Row, rank, standing
from app.methods.models import Method
from app.submissions.disclosure import Shown, disclose, seen_in_full
from app.submissions.lifecycle import State, Visibility
from app.submissions.models import Evaluation, Score, Submission
from app.tracks.service import current_facts, frames_of
from app.wiring import Wired
from evaluator.benchmark import Benchmark, Track
from evaluator.definition import Baseline
from evaluator.frames import Facts


@dataclass(frozen=True)
class Board:
    """A track's leaderboard.

    Attributes:
        facts: the ground truth in use; None before there is one.
        frames: how many frames it has for the track.
        rows: ranked rows first, then those that stand beside without rank.
    """

    benchmark: Benchmark
    track: Track
    facts: Facts | None
    frames: int
    rows: list[Row]

    @property
    def comparable(self) -> bool:
        """Whether its figures and the paper's are of the same frames."""
        return self.facts is None or self.facts.comparable


def find_track(wired: Wired, track_id: str) -> tuple[Benchmark, Track]:
    """A track by its id.

    Raises:
        NotFound: there is none; the text lists those that exist.
    """
    try:
        return wired.tracks[track_id]
    except KeyError:
        known = ", ".join(wired.tracks)
        raise NotFound(f"there is no track {track_id[:100]!r}; there are: {known}", code="unknown_track") from None


def board(wired: Wired, track_id: str) -> Board:
    """The board of a track.

    Raises:
        NotFound: there is no such track.
    """
    benchmark, track = find_track(wired, track_id)
    facts = current_facts(wired.db, benchmark)
    official = track.modality.official_mean
    in_full = seen_in_full(track, facts)
    rows = [
        Row(
            method=one.method,
            team=one.team,
            shown=disclose(one.results, official=official.name if official else None, in_full=in_full),
            submission_id=one.submission_id,
            submitted_at=one.created_at,
            inputs=one.inputs,
            training_data=one.training_data,
            paper=one.paper,
            code=one.code,
            attempt=attempt,
        )
        for one, attempt in standing(_candidates(wired, track, facts))
    ]
    paper = [_baseline_row(one, benchmark, track) for one in benchmark.baselines if one.track == track_id]
    frames = len(frames_of(facts, track))
    if not track.protocol.ranked:
        return Board(benchmark, track, facts, frames, [*_unranked(rows), *_unranked(paper)])
    if facts is not None and not facts.comparable:
        return Board(benchmark, track, facts, frames, [*rank(rows), *_unranked(paper)])
    return Board(benchmark, track, facts, frames, rank([*rows, *paper]))


def _candidates(wired: Wired, track: Track, facts: Facts | None) -> list[Candidate]:
    """Every submission of a track scored against the ground truth in use, its newest evaluation, in one SELECT."""
    if facts is None:
        return []
    query = (
        select(Submission, Method, Team.name, Score.results)
        .join(Method, Method.id == Submission.method_id)
        .join(Team, Team.id == Submission.team_id)
        .join(Evaluation, Evaluation.submission_id == Submission.id)
        .join(Score, Score.evaluation_id == Evaluation.id)
        .where(
            Submission.track == track.id,
            Submission.state == State.SCORED,
            Evaluation.groundtruth == facts.groundtruth,
        )
        .order_by(Evaluation.created_at)
    )
    with wired.db.read() as session:
        rows = session.execute(query).all()
    newest = {submission.id: (submission, method, team, results) for submission, method, team, results in rows}
    return [
        Candidate(
            submission_id=submission.id,
            method_id=method.id,
            method=method.name,
            team=team,
            created_at=submission.created_at,
            published_at=submission.published_at
            if submission.visibility is Visibility.PUBLIC and not submission.hidden
            else None,
            results=results,
            inputs=method.inputs,
            training_data=method.training_data,
            paper=method.paper,
            code=method.code,
        )
        for submission, method, team, results in newest.values()
    ]


def _baseline_row(one: Baseline, benchmark: Benchmark, track: Track) -> Row:
    """A row that the paper printed, in the terms of ours."""
    names = [benchmark.names[i] for i in track.scored]
    mean = track.modality.official_mean
    printed = track.official if mean and track.id in mean.baselines else ()
    known = [one.iou.get(benchmark.names[i], 0.0) for i in printed]  # what it adds was never right, so it counts 0
    return Row(
        method=one.title,
        team=benchmark.title,
        shown=Shown(
            miou=_fraction(one.miou),
            official=_fraction(sum(known) / len(known)) if known else None,
            classes={name: _fraction(one.iou.get(name)) for name in names},
            means={},
        ),
        year=benchmark.paper_year,
        baseline=True,
        source=f"Table {one.table}",
        note=one.note,
        paper=benchmark.url,
    )


def _fraction(percent: float | None) -> float | None:
    return None if percent is None else round(percent / 100, 6)


def _unranked(rows: list[Row]) -> list[Row]:
    """Rows in the order of their figures, without rank."""
    return [replace(row, rank=None) for row in rank(rows)]
