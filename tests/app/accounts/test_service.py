"""People and their tokens."""

from __future__ import annotations

import hashlib
from datetime import timedelta

import pytest
from sqlalchemy import select, update

from app.accounts.models import Membership, Person, Role, Scope, Team, Token, WebSession
from app.accounts.service import (
    SESSION_TIME,
    Identity,
    create_person,
    create_token,
    identify_session,
    identify_token,
    sign_in,
    sign_out,
)
from app.errors import Conflict, Invalid, NotFound, Unauthenticated
from tests.app.world import NOON, World


def sha256(secret: str) -> str:
    return hashlib.sha256(secret.encode()).hexdigest()


def revoke(world: World, token: str) -> None:
    with world.wired.db.begin() as session:
        session.execute(update(Token).where(Token.digest == sha256(token)).values(revoked_at=world.clock()))


def teams(world: World) -> list[str]:
    with world.wired.db.read() as session:
        return sorted(session.scalars(select(Team.name)))


def test_a_new_person_has_a_personal_team_of_the_same_name(world: World) -> None:
    person = create_person(world.wired.db, email=" Ada@Example.org ", role=Role.MAINTAINER, now=world.clock())
    assert (person.email, person.name, person.role, person.created_at) == (
        "ada@example.org",
        "ada",
        Role.MAINTAINER,
        world.clock(),
    )
    with world.wired.db.read() as session:
        [(team, member)] = session.execute(select(Team, Membership.person_id).join(Membership)).all()
    assert (team.name, team.personal, member) == ("ada", True, person.id)


def test_an_address_is_taken_once_however_it_is_spelled(world: World) -> None:
    world.person("ada@example.org")
    with pytest.raises(Conflict) as caught:
        create_person(world.wired.db, email="ADA@example.org", role=Role.MEMBER, now=world.clock())
    assert caught.value.detail == "ada@example.org exists already"
    assert teams(world) == ["ada"]


def test_people_whose_addresses_begin_alike_get_teams_of_different_names(world: World) -> None:
    for email in ("ada@a.org", "ada@b.org", "adam@a.org", "ada@c.org", "ad_a@a.org", "ada%@a.org"):
        world.person(email)
    assert teams(world) == ["ad_a", "ada", "ada 2", "ada 3", "ada%", "adam"]


@pytest.mark.parametrize("email", ["", "ada", "@example.org", "ada@", "a b@c.org", "ada@b@c.org", "a\x00@b.org"])
def test_what_is_no_address_makes_nobody(small_world: World, email: str) -> None:
    with pytest.raises(Invalid):
        create_person(small_world.wired.db, email=email, role=Role.MEMBER, now=small_world.clock())
    assert teams(small_world) == []


def test_a_token_says_who_holds_it_and_how_far_it_reaches(world: World) -> None:
    token = world.token("ada@example.org", role=Role.ADMINISTRATOR, scope=Scope.READ)
    who = identify_token(world.wired.db, token)
    with world.wired.db.read() as session:
        person, team = session.scalars(select(Person)).one(), session.scalars(select(Team)).one()
    assert who == Identity(person.id, "ada", "ada@example.org", Role.ADMINISTRATOR, Scope.READ, team.id, "ada")
    assert [who.may(scope) for scope in (Scope.READ, Scope.SUBMIT, Scope.ADMIN)] == [True, False, False]
    assert who.maintains


def test_scopes_include_the_ones_before_them(small_world: World) -> None:
    who = {scope: small_world.token(f"{scope}@example.org", scope=scope) for scope in Scope}
    may = {scope: [identify_token(small_world.wired.db, token).may(s) for s in Scope] for scope, token in who.items()}
    assert may == {
        Scope.READ: [True, False, False],
        Scope.SUBMIT: [True, True, False],
        Scope.ADMIN: [True, True, True],
    }


def test_only_the_digests_of_a_token_and_a_cookie_are_kept(world: World) -> None:
    token = world.token()
    cookie = sign_in(world.wired.db, token=token, now=world.clock())
    kept = []
    with world.wired.db.read() as session:
        for table in (Person, Team, Token, WebSession):
            for row in session.scalars(select(table)):
                kept += [getattr(row, column.key) for column in table.__table__.columns]
    assert token.startswith("wsc_")
    assert {sha256(token), sha256(cookie)} <= {str(one) for one in kept}
    assert not [one for one in kept if token in str(one) or cookie in str(one)]


def test_no_two_tokens_are_alike(small_world: World) -> None:
    small_world.token()
    made = {
        create_token(small_world.wired.db, email="ada@example.org", scope=Scope.READ, now=small_world.clock())
        for _ in range(5)
    }
    assert len(made) == 5
    assert min(map(len, made)) > 40


def test_nobody_gets_a_token_under_an_address_that_nobody_has(small_world: World) -> None:
    with pytest.raises(NotFound):
        create_token(small_world.wired.db, email="eve@example.org", scope=Scope.READ, now=small_world.clock())


@pytest.mark.parametrize("secret", ["", "wsc_wrong", "\x00", "ä"])
def test_an_unknown_token_is_refused(small_world: World, secret: str) -> None:
    with pytest.raises(Unauthenticated) as caught:
        identify_token(small_world.wired.db, secret)
    assert (caught.value.status, caught.value.code) == (401, "bad_token")


def test_a_revoked_token_is_refused_and_ends_the_sessions_that_it_opened(world: World) -> None:
    token = world.token()
    cookie = sign_in(world.wired.db, token=token, now=world.clock())
    revoke(world, token)
    for act in (lambda: identify_token(world.wired.db, token), lambda: sign_in(world.wired.db, token=token, now=NOON)):
        with pytest.raises(Unauthenticated):
            act()
    assert identify_session(world.wired.db, cookie, now=world.clock()) is None


def test_a_session_lasts_fourteen_days(world: World) -> None:
    token = world.token()
    cookie = sign_in(world.wired.db, token=token, now=world.clock())
    assert timedelta(days=14) == SESSION_TIME
    world.clock.advance(14 * 86400 - 1)
    assert identify_session(world.wired.db, cookie, now=world.clock()) == identify_token(world.wired.db, token)
    world.clock.advance(1)
    assert identify_session(world.wired.db, cookie, now=world.clock()) is None


def test_signing_out_ends_that_session_alone_and_may_be_repeated(world: World) -> None:
    token = world.token()
    here, there = (sign_in(world.wired.db, token=token, now=world.clock()) for _ in range(2))
    sign_out(world.wired.db, here)
    sign_out(world.wired.db, here)
    assert identify_session(world.wired.db, here, now=world.clock()) is None
    assert identify_session(world.wired.db, there, now=world.clock()) is not None


def test_a_cookie_that_was_never_given_is_nobodys(small_world: World) -> None:
    assert identify_session(small_world.wired.db, "invented", now=small_world.clock()) is None
