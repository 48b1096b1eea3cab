"""The web application: every router, and the frame of every page."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from anyio import to_thread
from fastapi import FastAPI, Request
from fastapi.responses import HTMLResponse
from fastapi.staticfiles import StaticFiles

from app import web
from app.accounts import pages as account_pages
from app.accounts.identity import viewer
from app.errors import Unauthenticated
from app.leaderboards import api as leaderboard_api
from app.leaderboards import pages as leaderboard_pages
from app.submissions import api as submission_api
from app.submissions import pages as submission_pages
from app.tracks import api as track_api
from app.tracks.service import current_facts
from app.wiring import Wired
from evaluator import __version__

THREADS = 8
"""Routes run in few threads: with the default of forty, SQLite's writers crowd each other out."""


def make_app(wired: Wired) -> FastAPI:
    """Put the application together."""
    benchmark = next(iter(wired.benchmarks.values()))
    app = FastAPI(
        title=f"{benchmark.title} evaluation server",
        version=__version__,
        openapi_url="/api/v1/openapi.json",
        docs_url=None,
        redoc_url=None,
        lifespan=_lifespan,
    )
    app.state.wired = wired
    pages = web.templates()

    def page(request: Request, name: str, context: dict[str, Any], status: int) -> HTMLResponse:
        return pages.TemplateResponse(request, name, {**_frame(request, wired), **context}, status_code=status)

    app.state.page = page
    web.install(app)
    app.mount("/static", StaticFiles(directory=web.HERE / "static"), name="static")
    for router in (
        track_api.router,
        submission_api.router,
        leaderboard_api.router,
        leaderboard_pages.router,
        submission_pages.router,
        account_pages.router,
    ):
        app.include_router(router)
    return app


@asynccontextmanager
async def _lifespan(_app: FastAPI) -> AsyncIterator[None]:
    to_thread.current_default_thread_limiter().total_tokens = THREADS
    yield


def _frame(request: Request, wired: Wired) -> dict[str, Any]:
    """What every page shows: the site, its tracks, who is signed in, and what must be said of its labels."""
    benchmark = next(iter(wired.benchmarks.values()))
    try:
        who = viewer(request, wired)
    except Unauthenticated:
        who = None
    return {
        "site": {"title": benchmark.title},
        "benchmark": benchmark,
        "version": __version__,
        "viewer": who,
        "nav_tracks": [{"id": track.id, "title": track.title} for _, track in wired.tracks.values()],
        "banner": " ".join(_warnings(wired)) or None,
    }


def _warnings(wired: Wired) -> list[str]:
    said = []
    for benchmark in wired.benchmarks.values():
        facts = current_facts(wired.db, benchmark)
        if facts and not facts.comparable:
            what = "are synthetic" if facts.synthetic else f"are not those of {benchmark.title}"
            said.append(
                f"{facts.title}: the labels on this server {what}. Scores here are not comparable with the paper, "
                "whose rows stand beside without rank."
            )
    return said
