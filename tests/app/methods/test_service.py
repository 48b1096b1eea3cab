"""Methods, made when they are first named."""

from __future__ import annotations

from functools import partial
from uuid import UUID

import pytest
from sqlalchemy import select

from app.errors import Invalid
from app.methods.models import Method
from app.methods.service import checked_name, find_or_make
from app.submissions.service import Begun
from tests.app.world import World, at_once


@pytest.mark.parametrize(
    ("name", "kept"),
    [
        ("  My \t method\n", "My method"),
        ("e\N{COMBINING ACUTE ACCENT}", "\N{LATIN SMALL LETTER E WITH ACUTE}"),
        ("x" * 100, "x" * 100),
        ("森林", "森林"),
    ],
)
def test_a_name_is_kept_with_its_white_space_folded_and_its_unicode_normalised(name: str, kept: str) -> None:
    assert checked_name(name) == kept


@pytest.mark.parametrize("name", ["x" * 101, "a\x00b", "a\N{RIGHT-TO-LEFT OVERRIDE}b", "a\N{ZERO WIDTH SPACE}b"])
def test_a_name_that_is_too_long_or_cannot_be_seen_is_refused(name: str) -> None:
    with pytest.raises(Invalid) as caught:
        checked_name(name)
    assert caught.value.code == "method_name"


@pytest.mark.parametrize("name", ["", " \t\n"])
def test_an_empty_name_is_refused_as_missing(name: str) -> None:
    with pytest.raises(Invalid) as caught:
        checked_name(name)
    assert caught.value.code == "method_missing"


def named(world: World) -> list[tuple[UUID, str]]:
    with world.wired.db.read() as session:
        rows = session.execute(select(Method.team_id, Method.name).order_by(Method.created_at, Method.name))
        return [(row[0], row[1]) for row in rows]


def test_a_method_is_made_once_and_found_again_under_other_spellings(world: World) -> None:
    team_id = world.person().team_id
    made = []
    for name in ("My method", " My  method "):
        with world.wired.db.begin() as session:
            method, new = find_or_make(session, team_id=team_id, name=name, now=world.clock())
            made.append((method.id, new))
    assert made == [(made[0][0], True), (made[0][0], False)]
    assert named(world) == [(team_id, "My method")]


def test_two_teams_may_have_methods_of_one_name(world: World) -> None:
    people = [world.person("ada@example.org"), world.person("bob@example.org")]
    for who in people:
        assert world.begin(who, method="Forest").method_created
    assert sorted(named(world)) == sorted((who.team_id, "Forest") for who in people)


def test_uploads_that_begin_together_for_a_new_method_of_one_name_share_it(world: World) -> None:
    who = world.person()
    for number in range(3):
        got = at_once([partial(world.begin, who, method=f"New {number}")] * 4)
        begun = [one for one in got if isinstance(one, Begun)]
        assert (got, sorted(one.method_created for one in begun)) == (begun, [False, False, False, True])
    assert named(world) == [(who.team_id, f"New {number}") for number in range(3)]
