"""What every route shares: the service at hand, errors as RFC 9457, pages, and headers that keep browsers safe."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import urlsplit

import structlog
from fastapi import Depends, FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse, JSONResponse
from jinja2 import StrictUndefined
from starlette.datastructures import MutableHeaders
from starlette.exceptions import HTTPException
from starlette.templating import Jinja2Templates
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.errors import Broken, Forbidden, Invalid, Refusal, Unauthenticated
from app.wiring import Wired

log = structlog.get_logger()

HERE = Path(__file__).parent
API = "/api/"
SECURITY = {
    "Content-Security-Policy": (
        "default-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'; object-src 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
}
BROKEN_PAGE = """<!doctype html>
<html lang="en">
<head><meta charset="utf-8"><title>{fault.title}</title><link rel="stylesheet" href="/static/site.css"></head>
<body><main class="page">
<h1>{fault.title}</h1><p>{fault.detail}</p><p><a href="/">Back to the home page</a></p>
</main></body>
</html>
"""
"""The page about a fault of ours: it asks nothing of the database, which may be what is broken."""
SAID = {404: "There is nothing at this address.", 405: "This address does not take that method."}
SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})


def wired(request: Request) -> Wired:
    """The service that answers this request."""
    found: Wired = request.app.state.wired
    return found


Wiring = Annotated[Wired, Depends(wired)]


def templates() -> Jinja2Templates:
    """The pages; an undefined name in one is an error, not an empty string."""
    made = Jinja2Templates(directory=HERE / "templates")
    made.env.undefined = StrictUndefined
    return made


def problem(refusal: Refusal) -> JSONResponse:
    """An error as RFC 9457 describes it, with a stable `code` and, where there are single problems, `errors`."""
    body = {
        "type": f"/errors/{refusal.code}",
        "title": refusal.title,
        "status": refusal.status,
        "detail": refusal.detail,
        "code": refusal.code,
    }
    if refusal.errors:
        body["errors"] = refusal.errors
    headers = {"WWW-Authenticate": "Bearer"} if isinstance(refusal, Unauthenticated) else None
    return JSONResponse(body, refusal.status, headers, media_type="application/problem+json")


Page = Callable[[Request, str, dict[str, Any], int], HTMLResponse]


def render(request: Request, name: str, context: dict[str, Any], status: int = 200) -> HTMLResponse:
    """A page inside the frame that every page has."""
    page: Page = request.app.state.page
    return page(request, name, context, status)


def install(app: FastAPI) -> None:
    """Give an application its error answers and its middleware."""

    def answer(request: Request, refusal: Refusal) -> Response:
        if request.url.path.startswith(API):
            return problem(refusal)
        context = {
            "status": refusal.status,
            "title": refusal.title,
            "detail": refusal.detail,
            "problems": refusal.errors,
        }
        return render(request, "error.html", context, refusal.status)

    @app.exception_handler(Refusal)
    def refused(request: Request, error: Refusal) -> Response:
        return answer(request, error)

    @app.exception_handler(RequestValidationError)
    def not_valid(request: Request, error: RequestValidationError) -> Response:
        wrong = [
            {
                "member": ".".join(str(part) for part in one["loc"][1:]) or None,
                "code": str(one["type"]),
                "expected": str(one["msg"]),
                "found": None,
                "hint": None,
            }
            for one in error.errors()
        ]
        said = "; ".join(f"{one['member']}: {one['expected']}" for one in wrong)
        return answer(request, Invalid(said, errors=wrong))

    @app.exception_handler(HTTPException)
    def http_error(request: Request, error: HTTPException) -> Response:
        detail = SAID.get(error.status_code, str(error.detail))
        refusal = Refusal(detail, code=str(error.detail).lower().replace(" ", "_"))
        refusal.status, refusal.title = error.status_code, str(error.detail)
        made = answer(request, refusal)
        for name, value in (error.headers or {}).items():
            made.headers[name] = value
        return made

    @app.exception_handler(Exception)
    def broken(request: Request, error: Exception) -> Response:
        log.error("unexpected", path=request.url.path, exc_info=error)
        fault = Broken("Something unexpected happened on our side; it was logged. Please try again.")
        to_api = request.url.path.startswith(API)
        made = problem(fault) if to_api else HTMLResponse(BROKEN_PAGE.format(fault=fault), fault.status)
        made.headers.update(SECURITY)  # Starlette sends this answer past every middleware
        return made

    def forged(request: Request) -> Response:
        return answer(request, Forbidden("this request came from another site", code="cross_site"))

    app.add_middleware(Guard, forged=forged)


class Guard:
    """Refuses what other sites make a browser send, and adds the headers that keep browsers safe.

    It stands outside of everything and looks at headers only, so that uploads and event streams pass untouched.
    """

    def __init__(self, app: ASGIApp, forged: Callable[[Request], Response]) -> None:
        """Wrap an application; `forged` makes the answer to what is refused."""
        self._app, self._forged = app, forged

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def send_safely(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in SECURITY.items():
                    headers.setdefault(name, value)
            await send(message)

        request = Request(scope)
        app: ASGIApp = self._forged(request) if _is_forged(request) else self._app
        await app(scope, receive, send_safely)


def _is_forged(request: Request) -> bool:
    """Whether another site made a browser send this: requests with a bearer token need no such check."""
    bearer = request.headers.get("authorization", "").lower().startswith("bearer ")
    if request.method in SAFE_METHODS or bearer:
        return False
    fetched = request.headers.get("sec-fetch-site")
    if fetched is not None and fetched not in ("same-origin", "none"):
        return True
    origin = request.headers.get("origin")
    try:
        return origin is not None and urlsplit(origin).netloc != request.headers.get("host")
    except ValueError:  # no address at all, such as http://[::1
        return True
