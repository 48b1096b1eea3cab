"""A service on a real database, with ground truth, for every test that asks."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import pytest
from starlette.testclient import TestClient

from app.database import migrate
from app.main import make_app
from app.settings import Settings
from app.tracks.service import import_release
from app.wiring import wire
from evaluator.benchmark import load
from evaluator.build import build
from tests.app.world import Clock, Predictions, World

NOBODY_LISTENS = "redis+socket:///nonexistent/broker.sock"


class Demo(Protocol):
    """What the fixture `demo` gives."""

    data: Path
    splits: Path
    groundtruth: Path


@pytest.fixture(scope="session")
def predictions(demo: Demo, tmp_path_factory: pytest.TempPathFactory) -> Predictions:
    return Predictions(demo.groundtruth, tmp_path_factory.mktemp("predictions"))


@pytest.fixture(scope="session")
def open_release(demo: Demo, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same labels, for everybody to see."""
    folder = tmp_path_factory.mktemp("open") / "groundtruth"
    build(demo.data, demo.splits, folder, load(), is_open=True)
    return folder


@pytest.fixture(scope="session")
def sqlite_template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A SQLite file with its tables made: copying it is ten times as fast as making them."""
    path = tmp_path_factory.mktemp("template") / "service.sqlite"
    migrate(f"sqlite:///{path}")
    return path


@pytest.fixture
def sqlite_url(tmp_path: Path, sqlite_template: Path) -> str:
    """The URL of a SQLite file of this test's own, its tables made."""
    shutil.copyfile(sqlite_template, tmp_path / "service.sqlite")
    return f"sqlite:///{tmp_path / 'service.sqlite'}"


@pytest.fixture
def make_world(tmp_path: Path, demo: Demo, predictions: Predictions) -> Iterator[Callable[..., World]]:
    """Makes a service on a database; further settings by name."""
    made: list[World] = []

    def make(database_url: str, *, release: Path | None = demo.groundtruth, **settings: Any) -> World:
        chosen = {"broker_url": NOBODY_LISTENS, "base_url": "http://testserver", **settings}
        clock = Clock()
        home = tmp_path / f"home-{len(made)}"
        home.mkdir()
        wired = replace(wire(Settings(home=home, database_url=database_url, **chosen)), now=clock)
        made.append(World(wired, clock, predictions))
        if release:
            [benchmark] = wired.benchmarks.values()
            import_release(wired.db, wired.settings.releases, release, benchmark, now=clock())
        return made[-1]

    yield make
    for one in made:
        one.wired.db.dispose()


@pytest.fixture
def world(make_world: Callable[..., World], database_url: str) -> World:
    """A service with ground truth, once on each kind of database; nobody listens to its queue."""
    return make_world(database_url)


@pytest.fixture
def small_world(make_world: Callable[..., World], sqlite_url: str) -> World:
    """A service with ground truth on SQLite, for what does not depend on the database."""
    return make_world(sqlite_url)


@pytest.fixture
def open_client() -> Iterator[Callable[[World], TestClient]]:
    """Makes visitors of a service's site; each has its own cookies."""
    opened: list[TestClient] = []

    def visit(world: World) -> TestClient:
        client = TestClient(make_app(world.wired), raise_server_exceptions=False, follow_redirects=False)
        opened.append(client)
        client.__enter__()
        return client

    yield visit
    for one in opened:
        one.__exit__(None, None, None)


@pytest.fixture
def client(small_world: World, open_client: Callable[[World], TestClient]) -> TestClient:
    """A visitor of `small_world`."""
    return open_client(small_world)
