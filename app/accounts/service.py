"""People and their tokens: made, recognised, signed in and out."""

from __future__ import annotations

import hashlib
import re
import secrets
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timedelta
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from app.accounts.models import Membership, Person, Role, Scope, Team, Token, WebSession
from app.database import Database
from app.errors import Conflict, Invalid, NotFound, Unauthenticated

TOKEN_PREFIX = "wsc_"  # noqa: S105 what tokens begin with, so that one is recognised where it leaks
TRIES = 5
SESSION_TIME = timedelta(days=14)
_EMAIL = re.compile(r"[^@\s\x00-\x1f]{1,64}@[^@\s\x00-\x1f]{1,189}")


@dataclass(frozen=True)
class Identity:
    """Who is asking, for which team, and how far their proof reaches."""

    person_id: UUID
    name: str
    email: str
    role: Role
    scope: Scope
    team_id: UUID
    team: str

    @property
    def maintains(self) -> bool:
        """Whether they run the benchmark."""
        return self.role in (Role.MAINTAINER, Role.ADMINISTRATOR)

    def may(self, scope: Scope) -> bool:
        """Whether their proof reaches this far."""
        order = list(Scope)
        return order.index(self.scope) >= order.index(scope)


def create_person(db: Database, *, email: str, role: Role, name: str | None = None, now: datetime) -> Person:
    """Make a person who can be given tokens, with a personal team of the same name.

    Raises:
        Invalid: that is no e-mail address.
        Conflict: the address is taken.
    """
    email = email.strip().lower()
    if not _EMAIL.fullmatch(email):
        raise Invalid(f"{email!r} is no e-mail address")
    name = (name or email.partition("@")[0])[:90]
    for _ in range(TRIES):
        with suppress(IntegrityError):  # somebody took the address or the team's name in the same moment: look again
            return _insert_person(db, email=email, role=role, name=name, now=now)
    raise Conflict(f"{email} cannot be made just now; try again")


def _insert_person(db: Database, *, email: str, role: Role, name: str, now: datetime) -> Person:
    with db.begin() as session:
        if session.scalar(select(Person).where(Person.email == email)):
            raise Conflict(f"{email} exists already")
        person = Person(email=email, name=name, role=role, created_at=now)
        taken = set(session.scalars(select(Team.name).where(Team.name.startswith(name, autoescape=True))))
        free = next(one for one in (name, *(f"{name} {n}" for n in range(2, len(taken) + 3))) if one not in taken)
        team = Team(name=free, personal=True, created_at=now)
        session.add_all([person, team])
        session.flush()
        session.add(Membership(team_id=team.id, person_id=person.id))
    return person


def create_token(db: Database, *, email: str, scope: Scope, name: str = "command line", now: datetime) -> str:
    """Give a person a token; the answer is its secret, which is kept nowhere.

    Raises:
        NotFound: nobody has this address.
    """
    secret = TOKEN_PREFIX + secrets.token_urlsafe(32)
    with db.begin() as session:
        person = session.scalar(select(Person).where(Person.email == email.strip().lower()))
        if person is None:
            raise NotFound(f"nobody has the address {email}")
        session.add(Token(person_id=person.id, name=name, scope=scope, digest=_digest(secret), created_at=now))
    return secret


def identify_token(db: Database, secret: str) -> Identity:
    """Who holds this token.

    Raises:
        Unauthenticated: nobody does.
    """
    with db.read() as session:
        token = session.scalar(select(Token).where(Token.digest == _digest(secret), Token.revoked_at.is_(None)))
        if token is None:
            raise Unauthenticated("this token is unknown or was revoked", code="bad_token")
        return _identity(session, token)


def sign_in(db: Database, *, token: str, now: datetime) -> str:
    """Open a browser session with a token; the answer is the cookie's value.

    Raises:
        Unauthenticated: the token is unknown.
    """
    identify_token(db, token)
    cookie = secrets.token_urlsafe(32)
    with db.begin() as session:
        held = session.scalars(select(Token).where(Token.digest == _digest(token))).one()
        session.add(WebSession(token_id=held.id, digest=_digest(cookie), created_at=now, expires_at=now + SESSION_TIME))
    return cookie


def identify_session(db: Database, cookie: str, *, now: datetime) -> Identity | None:
    """Who is signed in with this cookie; None when the session is over."""
    with db.read() as session:
        found = session.scalar(
            select(WebSession).where(WebSession.digest == _digest(cookie), WebSession.expires_at > now)
        )
        if found is None or found.token.revoked_at is not None:
            return None
        return _identity(session, found.token)


def sign_out(db: Database, cookie: str) -> None:
    """End a browser session."""
    with db.begin() as session:
        found = session.scalar(select(WebSession).where(WebSession.digest == _digest(cookie)))
        if found:
            session.delete(found)


def _identity(session: Session, token: Token) -> Identity:
    person = token.person
    team = session.scalars(
        select(Team).join(Membership).where(Membership.person_id == person.id).order_by(Team.personal.desc())
    ).first()
    if team is None:
        raise Unauthenticated("this account belongs to no team")
    return Identity(person.id, person.name, person.email, person.role, token.scope, team.id, team.name)


def _digest(secret: str) -> str:
    return hashlib.sha256(secret.encode()).hexdigest()
