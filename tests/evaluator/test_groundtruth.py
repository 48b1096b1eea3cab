"""Packed ground truth gives back every label, and notices when it does not."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from numpy.typing import NDArray

from evaluator.benchmark import Benchmark
from evaluator.errors import GroundTruthError
from evaluator.frames import Frame
from evaluator.groundtruth import GroundTruth, decode_runs, encode_runs, labels_digest, release_digest

if TYPE_CHECKING:
    from tests.evaluator.conftest import Planted


@given(
    st.one_of(
        arrays(np.uint8, array_shapes(min_dims=1, max_dims=2, min_side=0, max_side=30)),
        arrays(np.uint8, st.integers(0, 200), elements=st.sampled_from([0, 14, 255])),
    )
)
def test_runs_give_back_the_labels_that_they_were_made_from(labels: NDArray[np.uint8]) -> None:
    data = encode_runs(labels)
    runs = len(data) // 5
    assert runs == int(np.count_nonzero(np.diff(labels.ravel()))) + bool(labels.size)
    found = decode_runs(data, runs).expand(labels.size)
    assert found.dtype == np.uint8
    np.testing.assert_array_equal(found, labels.ravel())


def test_runs_are_the_classes_and_then_the_lengths() -> None:
    assert encode_runs(np.array([[7, 7], [7, 255]], np.uint8)) == b"\x07\xff" + b"\x03\0\0\0" + b"\x01\0\0\0"


def test_runs_that_give_another_number_of_labels_are_refused_before_memory_is_taken() -> None:
    with pytest.raises(ValueError, match="^4294967295 labels, expected 3$"):
        decode_runs(b"\x07" + b"\xff" * 4, 1).expand(3)


def test_the_digest_of_labels_is_that_of_their_bytes_row_by_row() -> None:
    assert labels_digest(np.array([[1, 2], [3, 255]], np.uint8)) == hashlib.sha256(b"\1\2\3\xff").hexdigest()


def test_every_frame_of_the_demo_comes_back_as_it_stands_in_the_data_set(demo: Planted) -> None:
    for track_id in ("2d-standard", "2d-val", "3d-standard", "3d-val"):
        track = demo.benchmark.track(track_id)
        answers = demo.answers(track_id)
        frames = demo.truth.frames(track)
        assert {(one.sequence, one.name) for one in frames} == set(answers)
        for frame in frames:
            true = answers[frame.sequence, frame.name]
            assert frame.shape == true.shape
            np.testing.assert_array_equal(demo.truth.labels(track, frame), true.ravel())


def test_an_intact_release_verifies(demo: Planted, small: Planted) -> None:
    assert demo.truth.verify() == []
    assert small.truth.verify() == []


@pytest.fixture
def copy(small: Planted, tmp_path: Path) -> Path:
    shutil.copytree(small.truth.folder, tmp_path / "copy")
    return tmp_path / "copy"


@pytest.mark.parametrize("modality", ["photo", "scan"])
def test_a_single_byte_that_is_flipped_is_noticed_wherever_it_stands(
    copy: Path, forest: Benchmark, modality: str
) -> None:
    file = copy / f"{modality}.runs"
    whole = file.read_bytes()
    for position in range(len(whole)):
        file.write_bytes(whole[:position] + bytes([whole[position] ^ 0x81]) + whole[position + 1 :])
        wrong = GroundTruth(copy, forest).verify()
        assert len(wrong) == 1
        assert wrong[0].startswith(f"{modality} frame ")
        assert wrong[0].endswith("is damaged") or " cannot be unpacked: " in wrong[0]


def test_a_file_that_is_cut_off_or_gone_is_noticed_frame_by_frame(copy: Path, forest: Benchmark) -> None:
    data = (copy / "scan.runs").read_bytes()
    (copy / "scan.runs").write_bytes(data[:-1])
    wrong = GroundTruth(copy, forest).verify()
    assert [one.split(":")[0] for one in wrong] == ["scan frame 4-000000001 cannot be unpacked"]
    (copy / "scan.runs").unlink()
    assert len(GroundTruth(copy, forest).verify()) == 5


def change(file: Path, **values: object) -> None:
    said = json.loads(file.read_text("utf-8")) | values
    file.write_text(json.dumps(said), "utf-8")


def test_a_frame_that_is_not_packed_is_noticed(copy: Path, forest: Benchmark) -> None:
    packed = json.loads((copy / "release.json").read_text("utf-8"))["modalities"]
    change(copy / "release.json", modalities={**packed, "scan": packed["scan"][:1]})
    assert GroundTruth(copy, forest).verify() == ["scan frame 4-000000001 is not packed"]


def test_a_manifest_that_was_changed_with_its_labels_does_not_match_the_digest(
    copy: Path, forest: Benchmark, small: Planted
) -> None:
    packed = json.loads((copy / "release.json").read_text("utf-8"))["modalities"]
    data = bytearray((copy / "scan.runs").read_bytes())
    assert data[0] == 0
    data[0] = 1
    (copy / "scan.runs").write_bytes(data)
    labels = small.truth.labels(forest.track("scan-whole"), small.truth.frames(forest.track("scan-whole"))[0])
    packed["scan"][0]["sha256"] = labels_digest(np.concatenate([[np.uint8(1)], labels[1:]]))
    change(copy / "release.json", modalities=packed)
    assert GroundTruth(copy, forest).verify() == ["the digest of the whole does not match"]


def test_a_class_that_the_benchmark_lacks_is_noticed(copy: Path, forest: Benchmark) -> None:
    packed = json.loads((copy / "release.json").read_text("utf-8"))["modalities"]
    data = bytearray((copy / "scan.runs").read_bytes())
    data[0] = 3
    (copy / "scan.runs").write_bytes(data)
    packed["scan"][0]["sha256"] = labels_digest(np.array([3, 1, 2, 255, 0, 1], np.uint8))
    change(copy / "release.json", modalities=packed)
    assert GroundTruth(copy, forest).verify() == ["scan frame 3-000000001 has a class that the benchmark lacks"]


def test_a_folder_without_a_release_is_refused(tmp_path: Path, forest: Benchmark) -> None:
    with pytest.raises(GroundTruthError, match="holds no packed ground truth: "):
        GroundTruth(tmp_path, forest)


def test_a_release_of_another_benchmark_is_refused(copy: Path, wildscenes: Benchmark) -> None:
    with pytest.raises(GroundTruthError, match=r"facts\.json is of benchmark 'forest', not 'wildscenes'$"):
        GroundTruth(copy, wildscenes)


def test_a_release_of_other_classes_is_refused(copy: Path, forest: Benchmark) -> None:
    change(copy / "release.json", classes=["leaf", "stone", "soil"])
    with pytest.raises(GroundTruthError, match="was packed for another benchmark or other classes; build it again$"):
        GroundTruth(copy, forest)


def test_facts_of_another_release_are_refused(copy: Path, forest: Benchmark) -> None:
    change(copy / "facts.json", groundtruth="0" * 64)
    with pytest.raises(GroundTruthError, match=r"facts\.json and release\.json are of different releases$"):
        GroundTruth(copy, forest)


def digested(small: Planted) -> dict[str, list[tuple[Frame, str]]]:
    return {
        modality: [(frame, labels_digest(np.zeros(frame.shape, np.uint8))) for frame in facts.frames]
        for modality, facts in small.truth.facts.modalities.items()
    }


@given(st.randoms(use_true_random=False))
def test_the_digest_of_a_release_does_not_depend_on_the_order_of_modalities_or_frames(
    small: Planted, random: Random
) -> None:
    frames = digested(small)
    turned = {modality: random.sample(frames[modality], len(frames[modality])) for modality in reversed(frames)}
    assert release_digest(small.benchmark, turned) == release_digest(small.benchmark, frames)


@pytest.mark.parametrize("field", ["name", "sequence", "split", "shape"])
def test_the_digest_of_a_release_depends_on_each_thing_that_is_said_of_a_frame(small: Planted, field: str) -> None:
    frames = digested(small)
    frame, digest = frames["photo"][0]
    other = frame.model_copy(update={field: (4, 2) if field == "shape" else "other"})
    changed = {**frames, "photo": [(other, digest), *frames["photo"][1:]]}
    assert release_digest(small.benchmark, changed) != release_digest(small.benchmark, frames)
