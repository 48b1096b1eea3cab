"""REST routes of tracks."""

from __future__ import annotations

from fastapi import APIRouter
from pydantic import BaseModel

from app.errors import NotFound
from app.tracks import service
from app.web import Wiring
from evaluator.frames import Facts

router = APIRouter(prefix="/api/v1/tracks", tags=["tracks"])


class TrackOut(BaseModel):
    """A track: what is trained on, tested on and scored; `frames` is null without ground truth on this server."""

    id: str
    benchmark: str
    title: str
    modality: str
    protocol: str
    trained_on: str
    test_sequences: list[str]
    classes: list[str]
    ranked: bool
    frames: int | None
    groundtruth: str | None
    links: dict[str, str]


@router.get("")
def list_tracks(wired: Wiring) -> list[TrackOut]:
    """Every track of this server."""
    facts = {one.id: service.current_facts(wired.db, one) for one in wired.benchmarks.values()}
    root = wired.settings.base_url.rstrip("/")
    made = []
    for benchmark, track in wired.tracks.values():
        here = facts[benchmark.id]
        frames = len(service.frames_of(here, track))
        made.append(
            TrackOut(
                id=track.id,
                benchmark=benchmark.id,
                title=track.title,
                modality=track.modality_id,
                protocol=track.protocol.id,
                trained_on=track.protocol.trained_on,
                test_sequences=list(track.protocol.test_sequences),
                classes=[benchmark.names[i] for i in track.scored],
                ranked=track.protocol.ranked,
                frames=frames or None,
                groundtruth=here.groundtruth if here and frames else None,
                links={
                    "facts": f"{root}/api/v1/tracks/{track.id}/facts",
                    "leaderboard": f"{root}/api/v1/leaderboards/{track.id}",
                },
            )
        )
    return made


@router.get("/{track}/facts")
def read_facts(track: str, wired: Wiring) -> Facts:
    """What a submission is checked against: frame names, sizes, and the class shares of the train split."""
    if track not in wired.tracks:
        raise NotFound(f"there is no track {track[:100]!r}", code="unknown_track")
    return service.track_facts(wired.db, *wired.tracks[track])
