"""A submission's figures depend on its labels alone: not on order, layout, compression, jobs or retries."""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

from evaluator.benchmark import load
from evaluator.errors import BenchmarkError
from evaluator.evaluate import conclude, evaluate, open_archive, plan, score_chunk
from evaluator.metrics import score
from evaluator.report import results

if TYPE_CHECKING:
    from tests.evaluator.conftest import Make, Planted

pytestmark = pytest.mark.usefixtures("either_path")


TRACKS = list(load().all_tracks)
SHIFTS = ["summer-to-summer", "winter-to-summer", "karawatha-to-karawatha", "venman-to-karawatha"]


def shift(labels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Labels a few places off, 255 as a submission may have it."""
    return np.roll(labels, 3, axis=-1)


@pytest.mark.parametrize("track_id", TRACKS)
def test_a_prediction_that_is_the_ground_truth_scores_exactly_1_for_every_class_present(
    demo: Planted, make: type[Make], tmp_path: Path, track_id: str
) -> None:
    outcome = demo.score(make.zip(tmp_path / "perfect.zip", demo.flat(track_id)), track_id)
    track = demo.benchmark.track(track_id)
    assert (outcome.problems, outcome.warnings) == ((), ())
    true = np.concatenate([labels.ravel() for labels in demo.answers(track_id).values()])
    counts = np.bincount(true, minlength=256)[:15]
    np.testing.assert_array_equal(outcome.confusion.sum(axis=0), np.column_stack([np.diag(counts), np.zeros(15)]))
    scores = score(outcome.confusion.sum(axis=0), track.scored)
    assert [one.iou for one in scores.classes.values()] == [1 if counts[i] else None for i in track.scored]
    assert scores.miou == scores.mean_accuracy == scores.accuracy == scores.fw_iou == 1


@pytest.mark.parametrize(("track_id", "encoding"), [("2d-standard", "raw19"), ("3d-standard", "benchmark")])
def test_the_data_sets_own_label_files_in_its_own_layout_are_a_perfect_submission(
    demo: Planted, make: type[Make], tmp_path: Path, track_id: str, encoding: str
) -> None:
    members = [(path.relative_to(demo.data).as_posix(), path.read_bytes()) for _, _, path in demo.rows(track_id)]
    outcome = demo.score(make.zip(tmp_path / "own.zip", members), track_id, encoding)
    assert (outcome.problems, outcome.warnings) == ((), ())
    assert score(outcome.confusion.sum(axis=0), demo.benchmark.track(track_id).scored).miou == 1


@pytest.mark.parametrize("track_id", ["2d-standard", "3d-standard"])
def test_each_frames_matrix_is_that_of_plain_numpy(
    demo: Planted, make: type[Make], tmp_path: Path, track_id: str
) -> None:
    outcome = demo.score(make.zip(tmp_path / "shifted.zip", demo.flat(track_id, shift)), track_id)
    answers = {frame: labels for (_, frame), labels in demo.answers(track_id).items()}
    assert outcome.frames == tuple(frame for _, frame in sorted(demo.answers(track_id)))
    for frame, matrix in zip(outcome.frames, outcome.confusion, strict=True):
        true, predicted = answers[frame].ravel(), np.minimum(shift(answers[frame]).ravel(), 15)
        expected = np.histogram2d(true, predicted, [np.arange(16) - 0.5, np.arange(17) - 0.5])[0]
        np.testing.assert_array_equal(matrix, expected)


@pytest.mark.parametrize("modality", ["2d", "3d"])
@pytest.mark.parametrize("protocol", SHIFTS)
def test_the_matrices_of_a_sub_splits_frames_add_up_to_what_it_scores_alone(
    demo: Planted, make: type[Make], tmp_path: Path, modality: str, protocol: str
) -> None:
    whole, part = f"{modality}-standard", f"{modality}-{protocol}"
    archive = make.zip(tmp_path / "shifted.zip", demo.flat(whole, shift))
    all_frames, alone = demo.score(archive, whole), demo.score(archive, part)
    names = {frame.name for frame in demo.truth.frames(demo.benchmark.track(part))}
    inside = [name in names for name in all_frames.frames]
    np.testing.assert_array_equal(all_frames.confusion[inside].sum(axis=0), alone.confusion.sum(axis=0))
    assert sum(inside) == len(alone.frames) == len(names) < len(all_frames.frames)


LAYOUTS = {
    "2d-standard": ["{f}", "{s}/{f}", "WildScenes2d/{s}/indexLabel/{f}", "run 7/{s}/{f}", "a/b/{f}"],
    "3d-standard": ["{f}", "{s}/{f}", "WildScenes3d/{s}/Labels/{f}", "sequences/{s}/predictions/{f}", "run/{f}"],
}


def said(
    demo: Planted, archive: Path, track_id: str, jobs: int = 1
) -> tuple[tuple[str, ...], list[object], dict[str, Any]]:
    """Everything that is said of a submission, frame by frame and as a whole."""
    outcome = demo.score(archive, track_id, jobs=jobs)
    assert outcome.problems == ()
    total = outcome.confusion.sum(axis=0)
    figures = results(total, demo.benchmark.track(track_id), demo.benchmark, digest="", frames=len(outcome.frames))
    return outcome.frames, outcome.confusion.tolist(), figures


@pytest.mark.parametrize("track_id", LAYOUTS)
@settings(max_examples=25)
@given(data=st.data())
def test_order_layout_compression_and_jobs_change_no_bit(
    demo: Planted, make: type[Make], tmp_path_factory: pytest.TempPathFactory, track_id: str, data: st.DataObject
) -> None:
    names = [(sequence, frame) for sequence, frame, _ in demo.rows(track_id)]
    flat = demo.flat(track_id, shift)
    suffix = demo.benchmark.track(track_id).modality.suffix
    plain = said(demo, make.zip(tmp_path_factory.getbasetemp() / f"{track_id}.zip", flat), track_id)
    with tempfile.TemporaryDirectory() as folder:
        other = Path(folder, "other.zip")
        with zipfile.ZipFile(other, "w") as archive:
            for sequence, frame in data.draw(st.permutations(names)):
                stem = frame.replace("-", data.draw(st.sampled_from("-.")))
                member = data.draw(st.sampled_from(LAYOUTS[track_id])).format(s=sequence, f=stem + suffix)
                compression = data.draw(st.sampled_from([zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED]))
                archive.writestr(member, flat[frame + suffix], compression)
        assert said(demo, other, track_id, jobs=data.draw(st.integers(1, 5))) == plain


@settings(max_examples=25)
@given(cuts=st.sets(st.integers(1, 9)), crashes=st.integers(0, 1))
def test_frames_cut_into_any_chunks_and_counted_again_after_a_crash_change_no_bit(
    demo: Planted, make: type[Make], tmp_path_factory: pytest.TempPathFactory, cuts: set[int], crashes: int
) -> None:
    path = make.zip(tmp_path_factory.getbasetemp() / "chunks.zip", demo.flat("2d-standard", shift))
    task = demo.task("2d-standard")
    edges = [0, *sorted(cuts), 10]
    with open_archive(path, demo.benchmark) as archive:
        matched = plan(archive, demo.truth.frames(task.track), task)
    chunks = []
    for start, end in pairwise(edges):
        for _ in range(crashes):
            with open_archive(path, demo.benchmark) as archive:
                score_chunk(archive, matched.pairs[start:end], task, demo.truth)
        with open_archive(path, demo.benchmark) as archive:
            chunks.append(score_chunk(archive, matched.pairs[start:end], task, demo.truth))
    found, whole = conclude(matched, chunks, task), demo.score(path, "2d-standard")
    np.testing.assert_array_equal(found.confusion, whole.confusion)
    assert (found.frames, found.problems, found.warnings) == (whole.frames, whole.problems, whole.warnings)


def test_a_submission_in_another_encoding_scores_the_same_once_it_is_named(
    small: Planted, make: type[Make], tmp_path: Path
) -> None:
    in_ids = np.array([1, 3, 4] + [0] * 253, np.uint8)
    photos = make.zip(tmp_path / "ids.zip", small.flat("photo-whole", lambda labels: in_ids[labels]))
    assert score(small.score(photos, "photo-whole", "ids").confusion.sum(axis=0), [0, 1, 2]).miou == 1
    assert not small.score(photos, "photo-whole").valid


def test_unlabelled_predictions_are_void_and_unlabelled_truth_is_not_counted(
    small: Planted, make: type[Make], tmp_path: Path
) -> None:
    members = {"3-000000001.label": make.cloud([255, 1, 0, 0, 0, 1]), "4-000000001.label": make.cloud([255] * 5)}
    outcome = small.score(make.zip(tmp_path / "void.zip", members), "scan-whole")
    assert outcome.confusion.tolist() == [
        [[1, 0, 0, 1], [0, 2, 0, 0], [1, 0, 0, 0]],
        [[0, 0, 0, 2], [0, 0, 0, 2], [0, 0, 0, 1]],
    ]


def test_checking_without_truth_finds_the_same_problems_and_counts_nothing(
    small: Planted, make: type[Make], tmp_path: Path
) -> None:
    archive = make.zip(tmp_path / "odd.zip", {"3-000000001.png": make.png([[0, 1, 2, 9], [0, 0, 0, 0]])})
    task = small.task("photo-whole")
    frames = small.truth.frames(task.track)
    checked, scored = evaluate(archive, task, frames), evaluate(archive, task, frames, small.truth)
    assert (checked.problems, checked.warnings) == (scored.problems, scored.warnings)
    assert len(checked.problems) == 2
    assert (checked.frames, checked.confusion.shape) == ((), (0, 3, 4))


def test_progress_ends_at_the_number_of_frames(demo: Planted, make: type[Make], tmp_path: Path) -> None:
    steps = []
    archive = make.zip(tmp_path / "perfect.zip", demo.flat("3d-standard"))
    task = demo.task("3d-standard")
    evaluate(archive, task, demo.truth.frames(task.track), jobs=3, progress=lambda *step: steps.append(step))
    assert steps == [*((done, 10) for done in (3, 6, 9)), (10, 10)]


def test_an_unknown_encoding_is_the_callers_mistake(small: Planted, make: type[Make], tmp_path: Path) -> None:
    archive = make.zip(tmp_path / "any.zip", {})
    with pytest.raises(BenchmarkError, match="^unknown label encoding 'cityscapes'; there are: benchmark, ids, two$"):
        evaluate(archive, small.task("photo-whole", "cityscapes"), None)


REAL = {"2d": "frame000104-1581624663_149.png", "3d": "000104.label"}


@pytest.mark.parametrize("modality", ["2d", "3d"])
def test_a_real_frame_of_another_data_set_scores_as_plain_numpy_says(
    shared: Path,
    request: pytest.FixtureRequest,
    make: type[Make],
    packing: Callable[..., Planted],
    tmp_path: Path,
    modality: str,
) -> None:
    rellis = load(request.path.parent / "rellis3d.toml")
    source = shared / "real" / "rellis3d" / REAL[modality]
    true = np.array(Image.open(source)) if modality == "2d" else np.fromfile(source, "<u4")
    held = tmp_path / "data" / "00004" / REAL[modality]
    held.parent.mkdir(parents=True)
    held.write_bytes(source.read_bytes())
    splits = tmp_path / "data" / "splits" / rellis.modalities[modality].splits
    splits.mkdir(parents=True)
    (splits / "test.csv").write_text(f"id,label_path\n{held.stem},00004/{held.name}\n", "utf-8")
    packed = packing(rellis, tmp_path / "data", tmp_path / "release", allow_absent=True)
    assert packed.truth.verify() == []

    predicted = np.roll(true, 7, axis=true.ndim - 1)
    kind = rellis.modalities[modality].kind
    archive = make.zip(tmp_path / "rolled.zip", {f"00004/{held.name}": make.labels(predicted, kind)})
    outcome = packed.score(archive, f"rellis3d-{modality}", "ids")
    assert (outcome.problems, outcome.warnings) == ((), ())

    ids = rellis.encodings["ids"].values
    expected = {}
    for index, name in enumerate(ids):
        if name not in ("", "unlabelled"):
            here, there = true == index, (predicted == index) & (true != 0)
            union = (here | there).sum()
            expected[name] = (here & there).sum() / union if union else None
    track = rellis.track(f"rellis3d-{modality}")
    figures = results(outcome.confusion.sum(axis=0), track, rellis, digest=packed.truth.digest, frames=1)
    assert {name: one["iou"] for name, one in figures["classes"].items()} == expected
    defined = [iou for iou in expected.values() if iou is not None]
    assert len(defined) == len(np.unique(true[true != 0]))
    assert figures["miou"] == pytest.approx(np.mean(defined), abs=1e-15)
