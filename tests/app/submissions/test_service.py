"""The use cases of submissions."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path
from uuid import UUID, uuid4

import pytest

from app.accounts.models import Role
from app.accounts.service import Identity
from app.errors import Conflict, Invalid, NotFound
from app.submissions import service
from app.submissions.lifecycle import Stage, State, Visibility
from app.submissions.service import Entry
from evaluator import SCORING_VERSION, __version__
from tests.app.world import NOON, World


@pytest.mark.parametrize(
    ("entry", "code"),
    [
        (Entry("", "M"), "track_missing"),
        (Entry("4d-standard", "M"), "unknown_track"),
        (Entry("2d-standard", ""), "method_missing"),
        (Entry("2d-standard", "M" * 101), "method_name"),
        (Entry("2d-standard", "M", encoding="cityscapes"), "unknown_encoding"),
    ],
)
def test_an_entry_that_cannot_become_a_submission_is_refused_by_name(
    small_world: World, entry: Entry, code: str
) -> None:
    who = small_world.person()
    with pytest.raises(Invalid) as caught:
        service.begin(small_world.wired, entry, who=who)
    assert caught.value.code == code
    assert service.list_of_team(small_world.wired, who=who) == []


def test_a_track_without_ground_truth_takes_no_submission(make_world: Callable[..., World], sqlite_url: str) -> None:
    world = make_world(sqlite_url, release=None)
    with pytest.raises(Conflict) as caught:
        world.begin(world.person())
    assert caught.value.code == "no_groundtruth"


def test_a_submission_that_begins_is_known_with_its_deadline_before_its_bytes_come(world: World) -> None:
    who = world.person()
    begun = service.begin(world.wired, Entry("3d-val", " My  method ", "mmdet3d13", Visibility.PUBLIC), who=who)
    found = world.submission(begun.id)
    assert {
        name: getattr(found, name)
        for name in ("benchmark", "track", "encoding", "state", "visibility", "hidden", "team_id", "uploader_id")
    } == {
        "benchmark": "wildscenes",
        "track": "3d-val",
        "encoding": "mmdet3d13",
        "state": State.RECEIVING,
        "visibility": Visibility.PUBLIC,
        "hidden": False,
        "team_id": who.team_id,
        "uploader_id": who.person_id,
    }
    assert (found.created_at, found.deadline, found.published_at) == (NOON, NOON + timedelta(seconds=300), NOON)
    assert (found.upload_key, found.sha256, found.size) == (None, None, None)


def test_a_submission_that_has_arrived_waits_with_an_evaluation_against_the_ground_truth_in_use(world: World) -> None:
    submission_id = world.submit(world.person(), data=b"zip")
    found, evaluation = world.submission(submission_id), world.evaluation(submission_id)
    sha256 = hashlib.sha256(b"zip").hexdigest()
    assert (found.state, found.sha256, found.size, found.deadline) == (State.QUEUED, sha256, 3, None)
    assert (evaluation.state, evaluation.first, evaluation.scoring, evaluation.evaluator) == (
        Stage.QUEUED,
        True,
        SCORING_VERSION,
        __version__,
    )
    [release] = [path.name for path in world.wired.settings.releases.iterdir()]
    assert (evaluation.groundtruth, evaluation.attempts, evaluation.sent_at) == (release, 0, NOON)


def test_bytes_are_accepted_once(world: World) -> None:
    begun = world.begin(world.person())
    world.arrive(begun, b"zip")
    with pytest.raises(Conflict):
        world.arrive(begun, b"again")
    assert world.submission(begun.id).size == 3


def test_an_upload_that_broke_off_ends_cancelled_and_only_while_it_was_arriving(world: World) -> None:
    who = world.person()
    begun = world.begin(who)
    service.broke_off(world.wired, begun.id, reason="the upload broke off")
    service.broke_off(world.wired, begun.id, reason="again")
    assert world.events(begun.id)[1:] == [("receiving", "cancelled", "the upload broke off")]
    arrived = world.submit(who, data=b"zip")
    service.broke_off(world.wired, arrived, reason="too late")
    assert world.submission(arrived).state is State.QUEUED


def may_read(world: World, submission_id: UUID, who: Identity | None) -> bool:
    try:
        return service.read(world.wired, submission_id, who=who).submission.id == submission_id
    except NotFound:
        return False


def test_a_submission_is_seen_by_its_team_and_maintainers_and_by_others_once_it_is_scored_and_public(
    world: World,
) -> None:
    owner, other = world.person("ada@example.org"), world.person("bob@example.org")
    maintainer = world.person("eve@example.org", role=Role.MAINTAINER)
    private, public = world.scored(owner, method="A"), world.scored(owner, method="B", public=True)
    waiting, hidden = world.submit(owner, public=True), world.scored(owner, method="C", public=True)
    service.hide(world.wired, hidden)
    seen = {
        name: [may_read(world, one, who) for one in (private, public, waiting, hidden)]
        for name, who in {"owner": owner, "maintainer": maintainer, "other": other, "visitor": None}.items()
    }
    assert seen == {
        "owner": [True] * 4,
        "maintainer": [True] * 4,
        "other": [False, True, False, False],
        "visitor": [False, True, False, False],
    }
    assert not may_read(world, uuid4(), owner)


def test_a_reading_says_which_of_the_methods_scored_attempts_it_is(world: World) -> None:
    who = world.person()
    first = world.scored(who)
    world.clock.advance(60)
    world.submit(who)
    second = world.scored(who)
    world.scored(who, method="Other")
    world.scored(who, track="2d-val")
    attempts = [service.read(world.wired, one, who=who).attempt for one in (first, second)]
    assert attempts == [(1, 2), (2, 2)]
    assert service.read(world.wired, world.submit(who), who=who).attempt is None


def test_publishing_shows_a_scored_submission_from_that_time_on_and_may_be_repeated(world: World) -> None:
    who = world.person()
    submission_id = world.scored(who)
    for _ in range(2):
        world.clock.advance(60)
        service.publish(world.wired, submission_id, who=who)
    found = world.submission(submission_id)
    assert (found.visibility, found.published_at) == (Visibility.PUBLIC, NOON + timedelta(seconds=60))
    assert world.events(submission_id)[4:] == [("scored", "scored", "published")]


def test_only_the_own_scored_submissions_can_be_published(world: World) -> None:
    owner, other = world.person("ada@example.org"), world.person("bob@example.org")
    waiting, scored = world.submit(owner), world.scored(owner)
    with pytest.raises(Conflict) as caught:
        service.publish(world.wired, waiting, who=owner)
    assert caught.value.detail == "only a scored submission can be published; this one is queued"
    for submission_id, who in ((scored, other), (uuid4(), owner)):
        with pytest.raises(NotFound):
            service.publish(world.wired, submission_id, who=who)
    assert world.submission(scored).visibility is Visibility.PRIVATE


def test_only_a_failed_submission_can_be_run_again(world: World) -> None:
    who = world.person()
    for submission_id in (world.scored(who), world.submit(who), world.begin(who).id):
        with pytest.raises(Conflict, match="^only a failed submission can be run again; this one is "):
            service.rerun(world.wired, submission_id)
    with pytest.raises(NotFound):
        service.rerun(world.wired, uuid4())


def test_a_hidden_submission_can_be_shown_again(world: World) -> None:
    submission_id = world.scored(world.person(), public=True)
    service.hide(world.wired, submission_id)
    assert not may_read(world, submission_id, None)
    service.hide(world.wired, submission_id, hidden=False)
    assert may_read(world, submission_id, None)
    assert world.events(submission_id)[4:] == [
        ("scored", "scored", "hidden by a maintainer"),
        ("scored", "scored", "shown again by a maintainer"),
    ]
    with pytest.raises(NotFound):
        service.hide(world.wired, uuid4())


def test_a_teams_list_is_its_own_and_the_newest_first(world: World) -> None:
    ada, bob = world.person("ada@example.org"), world.person("bob@example.org")
    made = []
    for who in (ada, bob, ada):
        made.append(world.scored(who))
        world.clock.advance(60)
    made.append(world.submit(ada))
    rows = service.list_of_team(world.wired, who=ada)
    expected = world.results(made[0])["miou"]
    assert [(one.id, score and score.miou) for one, score in rows] == [
        (made[3], None),
        (made[2], expected),
        (made[0], expected),
    ]


def test_maintainers_list_the_newest_of_everybody_and_may_ask_for_one_state(world: World) -> None:
    first = world.scored(world.person("ada@example.org"), method="A")
    world.clock.advance(60)
    second = world.submit(world.person("bob@example.org"), method="B")
    assert [(one.id, name) for one, name in service.newest(world.wired)] == [(second, "B"), (first, "A")]
    assert [one.id for one, _ in service.newest(world.wired, state=State.SCORED)] == [first]


def test_figures_are_open_on_practice_tracks_and_on_open_releases(
    make_world: Callable[..., World], sqlite_url: str, open_release: Path
) -> None:
    hidden = make_world(sqlite_url)
    who = hidden.person()
    ranked, practice = (hidden.submission(hidden.submit(who, track=track)) for track in ("2d-standard", "2d-val"))
    assert [service.is_open(hidden.wired, one) for one in (ranked, practice)] == [False, True]
    opened = make_world(sqlite_url, release=open_release)
    assert [service.is_open(opened.wired, one) for one in (ranked, practice)] == [True, True]
