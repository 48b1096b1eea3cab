"""What journeys share: servers run by the real command, people with tokens, and zips to send."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import httpx2
import numpy as np
import pytest

from evaluator.benchmark import Benchmark, load
from evaluator.build import build
from evaluator.demo import write_predictions
from evaluator.groundtruth import GroundTruth
from evaluator.pack import encode_labels

if TYPE_CHECKING:
    from tests.conftest import DataSet, Start

PROGRAM = str(Path(sys.executable).with_name("wildscenes"))
FINAL = {"scored", "rejected", "failed", "cancelled"}
PATIENCE = 90.0
"""Seconds that anything may take; far more than it does."""

T = TypeVar("T")


def wait_for(ask: Callable[[], T], *, pause: float = 0.05, said: Callable[[], object] = lambda: "") -> T:
    """Ask until the answer is truthy, and return it."""
    deadline = time.monotonic() + PATIENCE
    while not (answer := ask()):
        if time.monotonic() > deadline:
            pytest.fail(f"nothing happened in {PATIENCE:.0f} s; {said()}")
        time.sleep(pause)
    return answer


@pytest.fixture(scope="session")
def poll() -> Callable[..., Any]:
    """Waits for something, and fails when it does not come."""
    return wait_for


@dataclass
class Server:
    """A running service, and what people do with it."""

    url: str
    home: Path
    environment: dict[str, str]
    process: subprocess.Popen[bytes] | None = None
    output: Path = Path(os.devnull)

    def cli(self, *arguments: object, check: bool = True) -> subprocess.CompletedProcess[str]:
        """Run the command `wildscenes`."""
        command, own = [PROGRAM, *map(str, arguments)], {**os.environ, **self.environment}
        done = subprocess.run(command, env=own, capture_output=True, text=True, check=False, timeout=PATIENCE)
        assert not check or done.returncode == 0, done.stdout + done.stderr
        return done

    def token(self, name: str, scope: str = "submit") -> str:
        """A token of a new person, made without the second or two that the command takes to start."""
        from app.accounts.models import Role, Scope  # noqa: PLC0415 a slow import
        from app.accounts.service import create_person, create_token  # noqa: PLC0415 a slow import
        from app.database import Database  # noqa: PLC0415 a slow import

        email, now = f"{name}@example.org", datetime.now(UTC)
        db = Database(self.environment.get("WILDSCENES_DATABASE_URL") or f"sqlite:///{self.home}/wildscenes.sqlite")
        create_person(db, email=email, role=Role.MEMBER, now=now)
        token = create_token(db, email=email, scope=Scope(scope), now=now)
        db.dispose()
        return token

    def ask(self, method: str, path: str, token: str | None = None, **content: Any) -> httpx2.Response:
        """One request, with no redirect followed."""
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        headers |= content.pop("headers", {})
        with httpx2.Client(base_url=self.url, trust_env=False, timeout=60) as client:
            return client.request(method, path, headers=headers, **content)

    def get(self, path: str, token: str | None = None, **content: Any) -> httpx2.Response:
        return self.ask("GET", path, token, **content)

    def curl(self, archive: Path, token: str, **fields: str) -> tuple[int, dict[str, Any]]:
        """Submit as the documentation says; the answer is the status and the JSON."""
        form = [part for name, value in fields.items() for part in ("-F", f"{name}={value}")]
        form += ["-F", f"file=@{archive}", f"{self.url}/api/v1/submissions"]
        command = ["curl", "--silent", "--show-error", "--noproxy", "*", "--write-out", "\n%{http_code}"]
        command += ["-H", f"Authorization: Bearer {token}", *form]
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=PATIENCE)
        body, _, status = done.stdout.rpartition("\n")
        return int(status), json.loads(body)

    def send(self, archive: Path, token: str, **fields: str) -> str:
        """Submit a zip that is accepted; the answer is its id."""
        status, said = self.curl(archive, token, **fields)
        assert status == 202, said
        return str(said["id"])

    def settled(self, submission_id: str, token: str) -> dict[str, Any]:
        """A submission as the API shows it once its state is final."""
        said: dict[str, Any] = {}

        def is_final() -> bool:
            with contextlib.suppress(httpx2.TransportError):  # the web may just be starting again
                said.update(self.get(f"/api/v1/submissions/{submission_id}", token).json())
            return said.get("state") in FINAL

        wait_for(is_final, said=lambda: said)
        return said

    def uploads(self) -> set[str]:
        """The files that are kept."""
        return {path.name for path in (self.home / "uploads").glob("*")}

    def answers(self) -> bool:
        """Whether the web answers."""
        with contextlib.suppress(httpx2.TransportError):
            return self.get("/api/v1/tracks").status_code == 200
        return False


def below(pid: int) -> set[int]:
    """The processes below a process, from the kernel's table (Linux)."""
    parents = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            text = stat.read_text()
            state, parent = text.rpartition(")")[2].split()[:2]
            if state != "Z":
                parents[int(stat.parent.name)] = int(parent)
    found: set[int] = set()
    while more := {child for child, parent in parents.items() if parent in found | {pid}} - found:
        found |= more
    return found


@pytest.fixture(scope="session")
def descendants() -> Callable[[int], set[int]]:
    """Lists the processes below a process."""
    return below


def free_port() -> int:
    """A port of the loopback that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


MakeServer = Callable[..., Server]
Serve = Callable[..., Server]


def describe(home: Path, **settings: object) -> Server:
    """A server on a free port of the loopback, not running yet; keywords are settings, in lower case."""
    url = f"http://127.0.0.1:{free_port()}"
    told = {f"WILDSCENES_{name.upper()}": str(value) for name, value in settings.items()}
    own = {"WILDSCENES_HOME": str(home), "WILDSCENES_BASE_URL": url, "PYTHONUNBUFFERED": "1", "NO_PROXY": "*"}
    return Server(url, home, own | told)


@pytest.fixture(scope="session")
def make_server() -> MakeServer:
    """Describes a server whose processes the test starts itself: home and settings."""
    return describe


@pytest.fixture(scope="session")
def serve(tmp_path_factory: pytest.TempPathFactory, start_program: Start) -> Iterator[Serve]:
    """Runs `wildscenes serve` with these options on a home of its own; keywords are settings, in lower case."""
    servers: list[Server] = []

    def run(*options: object, home: Path | None = None, **settings: object) -> Server:
        made = describe(home or tmp_path_factory.mktemp("home"), **settings)
        made.output = tmp_path_factory.mktemp("output") / "serve.log"
        told = [PROGRAM, "serve", "--home", str(made.home), "--port", made.url.rpartition(":")[2], *map(str, options)]
        process = made.process = start_program(told, made.output, env={**os.environ, **made.environment})
        servers.append(made)

        up = "Ctrl-C stops the server"
        wait_for(lambda: up in made.output.read_text() or process.poll() is not None, said=made.output.read_text)
        assert up in made.output.read_text(), made.output.read_text()
        return made

    yield run
    stop(server.process for server in servers if server.process and server.process.poll() is None)


@pytest.fixture(scope="session")
def demo_server(serve: Serve, demo: DataSet) -> Server:
    """A server on the demo's ground truth that several modules share; each has people of its own."""
    return serve("--groundtruth", demo.groundtruth)


def stop(supervisors: Iterable[subprocess.Popen[bytes]]) -> None:
    """End servers with Ctrl-C's signal, all at once, and whatever does not heed it."""
    running = {process: below(process.pid) for process in supervisors}
    for process in running:
        process.send_signal(signal.SIGINT)
    for process, children in running.items():
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(PATIENCE)
        for pid in (process.pid, *children):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        process.wait()


@pytest.fixture(scope="session")
def wildscenes() -> Benchmark:
    """The WildScenes benchmark."""
    return load()


Predict = Callable[..., Path]


@pytest.fixture(scope="session")
def predict(demo: DataSet, wildscenes: Benchmark, tmp_path_factory: pytest.TempPathFactory) -> Predict:
    """Makes a zip of predictions for a track of the demo, better or worse."""

    def make(track_id: str, quality: float = 0.8, seed: int = 0) -> Path:
        truth, track = GroundTruth(demo.groundtruth, wildscenes), wildscenes.track(track_id)
        path = tmp_path_factory.mktemp("predictions") / f"{track_id}.zip"
        labelled = ((f.sequence, f.name, truth.labels(track, f).reshape(f.shape)) for f in truth.frames(track))
        kind = track.modality.kind
        write_predictions(labelled, path, kind=kind, quality=quality, seed=seed, k=wildscenes.k)
        return path

    return make


@dataclass(frozen=True)
class Noise:
    """A data set of random labels: `groundtruth` is its release, `frames` are its test frames with their sequences."""

    groundtruth: Path
    frames: dict[str, str]
    size: tuple[int, int]

    def zip(self, path: Path, modality: str = "2d", seed: int = 1, *, encode: Any = None) -> Path:
        """Predictions for every frame, also random; `encode` maps them to the indices that are written."""
        rng = np.random.default_rng(seed)
        width, height = self.size
        with zipfile.ZipFile(path, "w") as archive:
            for frame in self.frames:
                labels = rng.integers(0, 15, (height, width), np.uint8)
                labels = labels if modality == "2d" else labels.ravel()
                written = labels if encode is None else np.asarray(encode, np.uint8)[labels]
                kind, suffix = ("image", ".png") if modality == "2d" else ("cloud", ".label")
                archive.writestr(frame + suffix, encode_labels(written, kind))
        return path


@pytest.fixture(scope="session")
def make_noise(tmp_path_factory: pytest.TempPathFactory, wildscenes: Benchmark) -> Callable[..., Noise]:
    """Makes data sets of random labels, quickly and as large as one likes: frames, and the size of each."""

    def make(frames: int, size: tuple[int, int]) -> Noise:
        folder, rng = tmp_path_factory.mktemp("noise"), np.random.default_rng(0)
        sequences = [one.name for one in wildscenes.sequences]
        made = {f"{n:010}-000000001": sequences[n % len(sequences)] for n in range(frames)}
        for modality_id, modality in wildscenes.modalities.items():
            rows = ["id,label_path"]
            for name, sequence in made.items():
                path = folder / modality_id / sequence / (name + modality.suffix)
                path.parent.mkdir(parents=True, exist_ok=True)
                values = len(wildscenes.encodings[modality.groundtruth_encoding].values)
                labels = rng.integers(0, values, (size[1], size[0]), np.uint8)
                path.write_bytes(encode_labels(labels if modality.kind == "image" else labels.ravel(), modality.kind))
                rows.append(f"{name},{path.relative_to(folder).as_posix()}")
            split = folder / "splits" / modality.splits / "test.csv"
            split.parent.mkdir(parents=True)
            split.write_text("\n".join([*rows, ""]), "utf-8")
        build(folder, folder / "splits", folder / "release", wildscenes)
        return Noise(folder / "release", made, size)

    return make
