"""Signing in and out in a browser."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Form, Request, Response
from fastapi.responses import RedirectResponse

from app.accounts import service
from app.accounts.identity import COOKIE
from app.accounts.service import SESSION_TIME
from app.errors import Unauthenticated
from app.web import Wiring, render

router = APIRouter(include_in_schema=False)


def own_path(address: str) -> str:
    """A path of this site; anything else becomes the home page, so that nobody is led away after signing in."""
    fine = address.startswith("/") and not address.startswith(("//", "/\\")) and address.isprintable()
    return address if fine else "/"


@router.get("/sign-in")
def sign_in_form(request: Request, next: str = "/") -> Response:  # noqa: A002 the name in the address
    """The form that takes a token."""
    return render(request, "sign_in.html", {"next": own_path(next), "error": None})


@router.post("/sign-in")
def sign_in(
    request: Request,
    wired: Wiring,
    token: Annotated[str, Form(max_length=200)] = "",
    next: Annotated[str, Form(max_length=500)] = "/",  # noqa: A002 the name in the form
) -> Response:
    """Open a session with a token."""
    try:
        cookie = service.sign_in(wired.db, token=token.strip(), now=wired.now())
    except Unauthenticated as error:
        return render(request, "sign_in.html", {"next": own_path(next), "error": error.detail}, 401)
    response = RedirectResponse(own_path(next), 303)
    secure = wired.settings.base_url.startswith("https://")
    age = int(SESSION_TIME.total_seconds())
    response.set_cookie(COOKIE, cookie, max_age=age, httponly=True, samesite="lax", secure=secure)
    return response


@router.post("/sign-out")
def sign_out(request: Request, wired: Wiring) -> Response:
    """End the session."""
    cookie = request.cookies.get(COOKIE)
    if cookie:
        service.sign_out(wired.db, cookie)
    response = RedirectResponse("/", 303)
    response.delete_cookie(COOKIE)
    return response
