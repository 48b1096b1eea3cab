"""The files that host a server are valid, and keep apart what must be."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
BIN = Path(sys.executable).parent


def compose(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [BIN / "docker-compose", "--file", ROOT / "docker-compose.yml", *arguments],
        env={"PATH": os.environ["PATH"], "HOME": os.environ.get("HOME", "/"), **environment},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )


@pytest.fixture(scope="module")
def services() -> dict[str, Any]:
    said = compose("--profile", "*", "config", "--format", "json", WILDSCENES_DATABASE_PASSWORD="secret")
    assert said.returncode == 0, said.stderr
    found: dict[str, Any] = json.loads(said.stdout)["services"]
    return found


def test_the_compose_file_is_valid() -> None:
    said = compose("config", "-q", WILDSCENES_DATABASE_PASSWORD="secret")
    assert (said.returncode, said.stdout, said.stderr) == (0, "", "")


def test_a_server_without_a_database_password_does_not_start() -> None:
    said = compose("config", "-q")
    assert said.returncode != 0
    assert "WILDSCENES_DATABASE_PASSWORD" in said.stderr


def test_only_the_scoring_worker_and_the_maintainers_see_labels(services: dict[str, Any]) -> None:
    sees = {
        name: "read-only" if volume.get("read_only") else "writes"
        for name, service in services.items()
        for volume in service.get("volumes", [])
        if volume["source"] == "groundtruth"
    }
    assert sees == {"worker": "read-only", "admin": "writes"}


def test_what_opens_uploads_and_what_stores_them_reach_no_other_host(services: dict[str, Any]) -> None:
    reaches_out = {name for name, service in services.items() if "edge" in service["networks"]}
    assert reaches_out == {"web", "outbound"}


def test_every_started_service_is_watched(services: dict[str, Any]) -> None:
    with_own_check = {name for name, service in services.items() if service.get("healthcheck", {}).get("test")}
    assert with_own_check == {"worker", "outbound", "postgres", "redis"}  # the web's is in the image
    assert "HEALTHCHECK" in (ROOT / "Dockerfile").read_text("utf-8")


def test_the_dockerfile_has_no_finding() -> None:
    said = subprocess.run(
        [BIN / "hadolint", "--no-color", ROOT / "Dockerfile"], capture_output=True, text=True, check=False, timeout=60
    )
    assert (said.returncode, said.stdout) == (0, "")
