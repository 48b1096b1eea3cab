"""The request's person: from its bearer token, else from its cookie."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Request

from app.accounts import service
from app.accounts.models import Scope
from app.accounts.service import Identity
from app.errors import Forbidden, Unauthenticated
from app.web import Wiring

COOKIE = "wildscenes_session"


def viewer(request: Request, wired: Wiring) -> Identity | None:
    """Whoever is asking, or None for a visitor.

    Raises:
        Unauthenticated: a token was sent that nobody holds.
    """
    kind, _, secret = request.headers.get("authorization", "").partition(" ")
    if kind.lower() == "bearer":
        return service.identify_token(wired.db, secret.strip())
    cookie = request.cookies.get(COOKIE)
    return service.identify_session(wired.db, cookie, now=wired.now()) if cookie else None


def submitter(found: Annotated[Identity | None, Depends(viewer)]) -> Identity:
    """Whoever is asking, who must be allowed to submit.

    Raises:
        Unauthenticated: nobody is known.
        Forbidden: the token is for reading only.
    """
    if found is None:
        raise Unauthenticated("send 'Authorization: Bearer <token>', or sign in")
    if not found.may(Scope.SUBMIT):
        raise Forbidden("this token is for reading; one with scope 'submit' is needed", code="token_scope")
    return found


Viewer = Annotated[Identity | None, Depends(viewer)]
Submitter = Annotated[Identity, Depends(submitter)]
