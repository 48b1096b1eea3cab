"""A person with a browser: sign in, submit, watch, publish, read; with and without script, and for everybody."""

from __future__ import annotations

import os
import shutil
import signal
import zipfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from axe_core_python.sync_playwright import Axe  # type: ignore[import-untyped]
from playwright.sync_api import Browser, BrowserContext, Page, expect, sync_playwright

if TYPE_CHECKING:
    from tests.journeys.conftest import Predict, Server

ROOT = Path(__file__).resolve().parents[2]
FLAGS = """
--no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking --disable-component-update
--disable-sync
"""
PATIENT = 60_000
"""Milliseconds that a page may take; far more than it does."""


def chromium() -> str:
    """The browser's executable."""
    for name in ("chromium", "chromium-browser", "google-chrome"):
        if found := shutil.which(name):
            return found
    path = ROOT / ".cache" / "chromium" / "path"
    if path.is_file():
        return path.read_text("utf-8").strip()
    return pytest.fail(f"no browser: install Chromium, or run `make install`, which writes the path of one into {path}")


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=FLAGS.split())
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def token(demo_server: Server) -> str:
    return demo_server.token("browser")


Paused = Callable[[], AbstractContextManager[None]]


@pytest.fixture
def paused(demo_server: Server, descendants: Callable[[int], set[int]]) -> Paused:
    """Holds the worker still for a while, so that a page can be seen waiting."""

    @contextmanager
    def hold() -> Iterator[None]:
        assert demo_server.process is not None
        below = descendants(demo_server.process.pid)
        workers = [pid for pid in below if b"workers.celery" in Path(f"/proc/{pid}/cmdline").read_bytes()]
        assert len(workers) == 2  # the parent and the child that scores
        for pid in workers:
            os.kill(pid, signal.SIGSTOP)
        try:
            yield
        finally:
            for pid in workers:
                os.kill(pid, signal.SIGCONT)

    return hold


class Watched:
    """A page whose console is listened to: errors, and violations of the content security policy, which are errors."""

    def __init__(self, context: BrowserContext) -> None:
        self.page: Page = context.new_page()
        self.errors: list[str] = []
        self.page.on("console", lambda said: self.errors.append(said.text) if said.type == "error" else None)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))


def open_context(browser: Browser, server: Server, **options: Any) -> BrowserContext:
    context = browser.new_context(base_url=server.url, **options)
    context.set_default_timeout(PATIENT)
    return context


def sign_in(page: Page, token: str) -> None:
    page.goto("/submit")
    page.get_by_role("main").get_by_role("link", name="sign in").click()
    page.get_by_label("Access token").fill(token)
    page.get_by_role("button", name="Sign in").click()
    page.wait_for_url("**/submit*")


def submit(page: Page, archive: Path, *, track: str, method: str) -> None:
    page.goto("/submit")
    page.get_by_label("Track").select_option(track)
    page.get_by_label("Method").fill(method)
    page.get_by_label("Predictions").set_input_files(archive)
    page.get_by_role("button", name="Upload and score").click()
    page.wait_for_url("**/submissions/*")


@pytest.mark.parametrize("script", [True, False], ids=["with script", "without script"])
def test_a_zip_goes_from_the_form_to_the_board(
    browser: Browser, demo_server: Server, token: str, predict: Predict, paused: Paused, *, script: bool
) -> None:
    track, method = "2d-karawatha-to-karawatha", f"Browsed {'with' if script else 'without'} script"
    with open_context(browser, demo_server, java_script_enabled=script) as context:
        watched = Watched(context)
        page = watched.page
        sign_in(page, token)
        with paused():
            submit(page, predict(track), track=track, method=method)
            expect(page.get_by_role("heading", level=1)).to_have_text(method)
            expect(page.get_by_role("status")).to_have_text("Waiting for a worker")
            expect(page.locator(".state")).to_have_count(0)
        expect(page.get_by_text("Only your team sees this result")).to_be_visible(timeout=PATIENT)  # by itself
        expect(page.locator(".state")).to_have_text("Scored")
        shown = page.locator(".headline .main dd").inner_text()
        said = demo_server.get(f"/api/v1/submissions/{page.url.rpartition('/')[2]}", token).json()
        assert shown == f"{100 * said['scores']['miou']:.2f}"

        page.goto(f"/leaderboards/{track}")
        expect(page.get_by_role("link", name=method)).to_have_count(0)
        page.go_back()
        page.get_by_role("button", name="Publish").click()
        expect(page.get_by_role("button", name="Publish")).to_have_count(0)
        page.goto(f"/leaderboards/{track}")
        row = page.get_by_role("row").filter(has=page.get_by_role("link", name=method, exact=True))
        expect(row.locator(".miou")).to_have_text(shown)
        expect(row.locator(".rank")).to_have_text("1")
        page.get_by_role("link", name=method, exact=True).click()
        expect(page.locator(".headline .main dd")).to_have_text(shown)
        assert watched.errors == []


def test_a_refused_zip_and_a_refused_form_show_what_has_to_change(
    browser: Browser, demo_server: Server, token: str, predict: Predict, tmp_path: Path
) -> None:
    archive = tmp_path / "half.zip"
    with zipfile.ZipFile(predict("2d-standard")) as whole, zipfile.ZipFile(archive, "w") as half:
        for name in whole.namelist()[:6]:
            half.writestr(name, whole.read(name) if name != whole.namelist()[0] else b"no picture")
    with open_context(browser, demo_server) as context:
        watched = Watched(context)
        page = watched.page
        sign_in(page, token)
        submit(page, archive, track="2d-standard", method="Half")
        expect(page.get_by_role("heading", name="What has to change")).to_be_visible(timeout=PATIENT)
        rows = page.locator("table.problems tbody tr")
        expect(rows).to_have_count(5)
        expect(rows.filter(has_text="missing_frame")).to_have_count(4)
        expect(rows.filter(has_text="unreadable")).to_have_count(1)
        expect(page.locator(".scores")).to_have_count(0)
        assert watched.errors == []

        page.goto("/submit")
        page.get_by_label("Method").fill("\N{RIGHT-TO-LEFT OVERRIDE}x")
        page.get_by_label("Predictions").set_input_files(archive)
        page.get_by_role("button", name="Upload and score").click()
        expect(page.get_by_role("alert")).to_contain_text("at most 100 visible characters")
        assert page.get_by_label("Predictions").evaluate("field => field.files.length") == 1


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (360, "dark")])
def test_axe_finds_no_fault_on_any_page(
    browser: Browser, demo_server: Server, token: str, predict: Predict, scheme: Any, width: int
) -> None:
    track = "3d-karawatha-to-karawatha"
    scored = demo_server.send(predict(track), token, track=track, method="For all", visibility="public")
    refused = demo_server.send(predict(track), token, track="3d-standard", method="For all")
    for one in (scored, refused):
        demo_server.settled(one, token)
    size: Any = {"width": width, "height": 900}
    with open_context(browser, demo_server, bypass_csp=True, color_scheme=scheme, viewport=size) as context:
        page = context.new_page()
        pages = ["/", f"/leaderboards/{track}", "/sign-in", "/submit", "/nowhere"]
        own = ["/submit", "/submissions", f"/submissions/{scored}", f"/submissions/{refused}"]
        faults = {path: axe_faults(page, path) for path in pages}
        sign_in(page, token)
        faults |= {f"{path}, signed in": axe_faults(page, path) for path in own}
        wide = {path: page.evaluate("document.documentElement.scrollWidth") for path in pages if page.goto(path)}
    assert {path: found for path, found in faults.items() if found} == {}
    assert {path: pixels for path, pixels in wide.items() if pixels > width} == {}


def axe_faults(page: Page, path: str) -> list[str]:
    """What axe finds on a page: rule and place of each fault."""
    page.goto(path)
    found = Axe().run(page)["violations"]
    return [f"{one['id']}: {node['target']}" for one in found for node in one["nodes"]]
