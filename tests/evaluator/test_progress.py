"""A progress bar is drawn where a person watches, and nowhere else."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.evaluator.conftest import Make, Planted


@pytest.fixture
def command(demo: Planted, make: type[Make], tmp_path: Path) -> list[str]:
    archive = make.zip(tmp_path / "perfect.zip", demo.flat("2d-val"))
    options = ["--track", "2d-val", "--groundtruth", str(demo.truth.folder)]
    return [sys.executable, "-W", "error", "-m", "evaluator.cli", "evaluate", str(archive), *options]


def test_in_a_pipe_there_is_no_progress_bar(command: list[str]) -> None:
    done = subprocess.run(command, check=False, capture_output=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.decode().splitlines()[0].split() == ["class", "IoU", "precision", "recall", "F1"]


def test_in_a_terminal_there_is_a_progress_bar_on_standard_error(command: list[str]) -> None:
    watcher, terminal = pty.openpty()
    try:
        done = subprocess.run(command, check=False, stdout=subprocess.PIPE, stderr=terminal, timeout=60)
        drawn = os.read(watcher, 10_000)
    finally:
        os.close(terminal)
        os.close(watcher)
    assert done.returncode == 0
    assert b"scoring" in drawn
    assert b"100%" in drawn
