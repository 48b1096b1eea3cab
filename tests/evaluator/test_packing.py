"""A build that broke off goes on where it stood, and makes what an undisturbed one makes."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray

from evaluator.build import build
from evaluator.groundtruth import GroundTruth, labels_digest

if TYPE_CHECKING:
    from tests.evaluator.conftest import Planted


class _Break(Exception):
    """What stops a build in the middle."""


def broken_off(small: Planted, out: Path, after: int) -> None:
    """Build until so many files are packed, then break off as Ctrl-C would."""

    def stop(done: int, _: int) -> None:
        if done == after:
            raise _Break

    with pytest.raises(_Break):
        build(small.data, small.splits, out, small.benchmark, allow_absent=True, progress=stop)
    assert not out.exists()


@pytest.mark.parametrize("after", [1, 3, 5])
def test_a_build_that_broke_off_goes_on_and_makes_the_same_bytes(small: Planted, tmp_path: Path, after: int) -> None:
    broken_off(small, tmp_path / "out", after)
    build(small.data, small.splits, tmp_path / "whole", small.benchmark, allow_absent=True)
    release = build(small.data, small.splits, tmp_path / "out", small.benchmark, allow_absent=True)
    assert GroundTruth(tmp_path / "out", small.benchmark).verify() == []
    assert release.groundtruth == GroundTruth(tmp_path / "whole", small.benchmark).digest
    made = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    assert made == {path.name: path.read_bytes() for path in (tmp_path / "whole").iterdir()}
    assert {path.name for path in tmp_path.iterdir()} == {"out", "whole"}


def test_what_was_packed_before_is_not_read_again(
    small: Planted, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken_off(small, tmp_path / "out", 3)
    read: list[int] = []

    def watched(labels: NDArray[np.uint8]) -> str:
        read.append(labels.size)
        return labels_digest(labels)

    monkeypatch.setattr("evaluator.packing.labels_digest", watched)
    total: set[int] = set()
    build(
        small.data,
        small.splits,
        tmp_path / "out",
        small.benchmark,
        allow_absent=True,
        progress=lambda _, files: total.add(files),
    )
    assert [len(read)] == [files - 3 for files in total]


@pytest.mark.parametrize("damage", [b"", b"x", b"{}\n", b"\xff\xfe"])
def test_a_journal_that_ends_in_the_middle_of_a_line_is_followed_up_to_there(
    small: Planted, tmp_path: Path, damage: bytes
) -> None:
    broken_off(small, tmp_path / "out", 4)
    for journal in (tmp_path / ".out.partial").glob("*.journal"):
        journal.write_bytes(journal.read_bytes()[:-40] + damage)
    build(small.data, small.splits, tmp_path / "out", small.benchmark, allow_absent=True)
    truth = GroundTruth(tmp_path / "out", small.benchmark)
    assert (truth.verify(), truth.digest) == ([], small.truth.digest)


def test_a_file_that_changed_since_is_packed_again(small: Planted, tmp_path: Path) -> None:
    data = tmp_path / "data"
    shutil.copytree(small.data, data)
    copied = replace(small, data=data, splits=data / "splits")
    broken_off(copied, tmp_path / "out", 5)
    for path in data.rglob("*.label"):
        path.touch()
    build(data, data / "splits", tmp_path / "out", small.benchmark, allow_absent=True)
    truth = GroundTruth(tmp_path / "out", small.benchmark)
    assert (truth.verify(), truth.digest) == ([], small.truth.digest)
