"""Frames have one spelling; the public facts of a release say which there are and what else may be known."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from evaluator.benchmark import Benchmark
from evaluator.errors import GroundTruthError
from evaluator.frames import Frame, ModalityFacts, frame_name, is_comparable, read_facts

if TYPE_CHECKING:
    from tests.evaluator.conftest import Planted


@given(st.integers(0, 10**10), st.text("0123456789", min_size=1, max_size=9))
def test_a_point_or_a_dash_between_seconds_and_nanoseconds_is_the_same_name(seconds: int, nanoseconds: str) -> None:
    assert frame_name(f"{seconds}.{nanoseconds}") == f"{seconds}-{nanoseconds}"
    assert frame_name(f"{seconds}-{nanoseconds}") == f"{seconds}-{nanoseconds}"


@pytest.mark.parametrize(
    "stem", ["", "README", "1.2.3", "a1.2", "1.2a", "1.", ".2", "1-2-3", "frame000104-1581624663_149"]
)
def test_a_stem_that_is_no_timestamp_stays_as_it_is(stem: str) -> None:
    assert frame_name(stem) == stem


def test_the_frames_of_a_track_are_those_of_its_split_and_sequences_in_the_order_of_sequences_and_names(
    small: Planted,
) -> None:
    whole = small.benchmark.track("photo-whole")
    north = Frame(name="3-000000001", sequence="North", split="test", shape=(2, 4))
    south = Frame(name="4-000000001", sequence="South", split="test", shape=(2, 4))
    assert small.truth.facts.frames(whole) == (north, south)
    frames = tuple(reversed(small.truth.facts.modalities["photo"].frames))
    turned = small.truth.facts.model_copy(update={"modalities": {"photo": ModalityFacts(frames=frames)}})
    assert turned.frames(whole) == (north, south)


def test_a_release_without_frames_of_a_track_says_so(small: Planted) -> None:
    facts = small.truth.facts.model_copy(update={"modalities": {}})
    with pytest.raises(GroundTruthError, match="^this release has no frames for track scan-whole$"):
        facts.frames(small.benchmark.track("scan-whole"))


def test_the_facts_of_one_track_are_its_frames_and_the_shares_of_its_modality(small: Planted) -> None:
    whole = small.truth.facts
    practice = small.benchmark.track("photo-practice")
    assert whole.of_track(practice).model_dump(mode="json") == {
        "format": 1,
        "benchmark": "forest",
        "title": "Forest",
        "groundtruth": small.truth.digest,
        "open": False,
        "synthetic": False,
        "comparable": True,
        "modalities": {
            "photo": {
                "frames": [{"name": "2-000000001", "sequence": "North", "split": "val", "shape": [2, 4]}],
                "train_shares": {"leaf": 0.75, "soil": 0.25, "stone": 0.0},
            }
        },
    }


def test_facts_come_back_from_their_file(small: Planted, tmp_path: Path) -> None:
    file = tmp_path / "facts.json"
    file.write_text(small.truth.facts.model_dump_json(), "utf-8")
    assert read_facts(file, small.benchmark) == small.truth.facts


def test_facts_of_another_benchmark_are_refused(small: Planted, wildscenes: Benchmark, tmp_path: Path) -> None:
    file = tmp_path / "facts.json"
    file.write_text(small.truth.facts.model_dump_json(), "utf-8")
    with pytest.raises(GroundTruthError, match=r"facts\.json is of benchmark 'forest', not 'wildscenes'$"):
        read_facts(file, wildscenes)


@pytest.mark.parametrize("content", [b"", b"{}", b"\xff\x00", b"[1]"])
def test_a_file_that_holds_no_facts_is_refused(content: bytes, forest: Benchmark, tmp_path: Path) -> None:
    file = tmp_path / "facts.json"
    file.write_bytes(content)
    with pytest.raises(GroundTruthError, match=r"facts\.json is no file of facts: "):
        read_facts(file, forest)


def test_facts_that_do_not_exist_are_refused(forest: Benchmark, tmp_path: Path) -> None:
    with pytest.raises(GroundTruthError, match="is no file of facts: .*No such file"):
        read_facts(tmp_path / "facts.json", forest)


def test_facts_with_anything_more_in_them_are_refused(small: Planted, forest: Benchmark, tmp_path: Path) -> None:
    file = tmp_path / "facts.json"
    said = json.loads(small.truth.facts.model_dump_json())
    file.write_text(json.dumps(said | {"totals": {"leaf": 5}}), "utf-8")
    with pytest.raises(GroundTruthError, match="totals"):
        read_facts(file, forest)


@pytest.mark.parametrize(
    ("frames", "synthetic", "comparable"),
    [(2, False, True), (2, True, False), (1, False, False), (3, False, False), (0, False, True)],
)
def test_a_release_is_comparable_when_each_track_it_has_holds_the_papers_number_of_frames(
    forest: Benchmark, frames: int, *, synthetic: bool, comparable: bool
) -> None:
    listed = tuple(Frame(name=f"{i}-1", sequence="North", split="test", shape=(1, 1)) for i in range(frames))
    assert is_comparable(forest, {"photo": ModalityFacts(frames=listed)}, synthetic=synthetic) is comparable
