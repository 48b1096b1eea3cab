"""The demo data set has the layout, the classes and the determinism that the rest of the code relies on."""

from __future__ import annotations

import csv
import json
import zipfile
from datetime import datetime, timezone
from io import BytesIO
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from PIL import Image

from evaluator.benchmark import INVALID, UNLABELLED, Benchmark, load
from evaluator.demo import degrade, write_demo, write_predictions
from evaluator.errors import BenchmarkError

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

WILDSCENES = load()
NAMES = set(WILDSCENES.names)
SMALLEST: dict[str, Any] = {"frames": 1, "size": (32, 24), "points": 200}


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("demo")
    write_demo(folder)
    return folder


def rows(folder: Path, modality: str, split: str) -> list[dict[str, str]]:
    with (folder / "splits" / f"opt{modality}" / f"{split}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def read(path: Path) -> NDArray[np.uint8]:
    """A label file's indices as they are stored."""
    if path.suffix == ".png":
        with Image.open(path) as image:
            assert image.mode == "L"
            return np.array(image)
    return (np.fromfile(path, "<u4") & 0xFFFF).astype(np.uint8)


def canonical(path: Path) -> NDArray[np.uint8]:
    encoding = "raw19" if path.suffix == ".png" else "benchmark"
    labels = WILDSCENES.columns(encoding)[read(path)]
    return np.where(labels == WILDSCENES.k, UNLABELLED, labels).astype(np.uint8)


def classes(folder: Path, modality: str, split: str, sequences: set[str]) -> set[str]:
    """Names of the classes in the ground truth of these sequences' frames of a split."""
    seen: set[int] = set()
    for row in rows(folder, modality, split):
        if row["label_path"].split("/")[1] in sequences:
            seen |= set(np.unique(canonical(folder / row["label_path"])).tolist())
    return {WILDSCENES.names[index] for index in seen - {UNLABELLED}}


def contents(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("frames", [1, 2, 5])
def test_every_class_is_in_every_part_that_is_scored_even_in_the_smallest_demo(
    tmp_path: Path, seed: int, frames: int
) -> None:
    write_demo(tmp_path, **{**SMALLEST, "frames": frames, "seed": seed})
    for modality, expected in (("2d", NAMES), ("3d", NAMES - {"sky", "water"})):
        assert classes(tmp_path, modality, "test", {"V-03", "K-03"}) == expected
        assert classes(tmp_path, modality, "test", {"K-01", "K-03"}) == expected
        assert classes(tmp_path, modality, "val", {"K-01"}) == expected
        assert classes(tmp_path, modality, "train", {one.name for one in WILDSCENES.sequences}) == expected


def test_each_track_has_every_class_that_it_scores(demo: Path) -> None:
    for track in WILDSCENES.all_tracks.values():
        found = classes(demo, track.modality_id, track.protocol.split, set(track.protocol.test_sequences))
        assert {WILDSCENES.names[index] for index in track.scored} <= found, track.id


def test_the_same_seed_gives_the_same_bytes_and_another_seed_gives_others(tmp_path: Path) -> None:
    for name, seed in (("first", 3), ("again", 3), ("other", 4)):
        write_demo(tmp_path / name, **{**SMALLEST, "seed": seed})
    first, again, other = (contents(tmp_path / name) for name in ("first", "again", "other"))
    assert first == again
    assert set(first) & set(other) == {
        "dataset.json",
        *(f"splits/opt{modality}/{split}.csv" for modality in ("2d", "3d") for split in ("train", "val", "test")),
    }


def test_split_files_have_the_columns_and_paths_of_the_release(demo: Path) -> None:
    for split in ("train", "val", "test"):
        for row in rows(demo, "2d", split):
            name, sequence = row["id"], row["label_path"].split("/")[1]
            assert row == {
                "id": name,
                "im_path": f"WildScenes2d/{sequence}/image/{name}.png",
                "label_path": f"WildScenes2d/{sequence}/indexLabel/{name}.png",
            }
        for row in rows(demo, "3d", split):
            name, sequence = row["id"].replace("-", "."), row["label_path"].split("/")[1]
            assert row == {
                "id": row["id"],
                "lidar_path": f"WildScenes3d/{sequence}/Clouds/{name}.bin",
                "label_path": f"WildScenes3d/{sequence}/Labels/{name}.label",
                "hist_path": f"WildScenes3d/{sequence}/Hists/{name}.csv",
            }


def test_the_folder_holds_the_listed_labels_and_nothing_else(demo: Path) -> None:
    listed = [row["label_path"] for m in ("2d", "3d") for s in ("train", "val", "test") for row in rows(demo, m, s)]
    splits = [f"splits/opt{m}/{s}.csv" for m in ("2d", "3d") for s in ("train", "val", "test")]
    assert sorted(contents(demo)) == sorted([*listed, *splits, "dataset.json"])


def test_each_sequence_has_as_many_frames_as_asked_for_and_only_k_01_has_val_frames(demo: Path) -> None:
    for modality in ("2d", "3d"):
        counts = {
            (split, one.name): sum(f"/{one.name}/" in row["label_path"] for row in rows(demo, modality, split))
            for split in ("train", "val", "test")
            for one in WILDSCENES.sequences
        }
        assert counts == {
            (split, one.name): 6 if split != "val" else 3 * (one.name == "K-01")
            for split in ("train", "val", "test")
            for one in WILDSCENES.sequences
        }


@pytest.mark.parametrize("seed", [0, 11])
def test_frames_are_named_by_unique_times_of_their_sequence_s_month(tmp_path: Path, seed: int) -> None:
    write_demo(tmp_path, **{**SMALLEST, "frames": 4, "seed": seed})
    months = {one.name: one.date for one in WILDSCENES.sequences}
    for modality in ("2d", "3d"):
        named = [
            (row["id"], row["label_path"])
            for split in ("train", "val", "test")
            for row in rows(tmp_path, modality, split)
        ]
        assert len({name for name, _ in named}) == len(named) == 42
        for name, path in named:
            seconds, nanoseconds = name.split("-")
            assert (len(seconds), len(nanoseconds)) == (10, 9)
            taken = datetime.fromtimestamp(int(seconds), timezone.utc)
            assert f"{taken:%Y-%m}" == months[path.split("/")[1]]


def test_images_are_raw19_with_unlabelled_asphalt_and_pole_of_the_size_asked_for(demo: Path) -> None:
    maps = [read(path) for path in (demo / "WildScenes2d").rglob("*.png")]
    values = set(np.unique(np.concatenate([labels.ravel() for labels in maps])).tolist())
    assert {labels.shape for labels in maps} == {(189, 252)}
    assert values == set(range(19))


def test_clouds_are_benchmark_indices_with_other_things_in_the_upper_bits(demo: Path) -> None:
    clouds = [np.fromfile(path, "<u4") for path in (demo / "WildScenes3d").rglob("*.label")]
    points = np.concatenate(clouds)
    expected = {index for index, name in enumerate(WILDSCENES.names) if name not in {"sky", "water"}} | {UNLABELLED}
    assert set(np.unique(points & 0xFFFF).tolist()) == expected
    assert 0.2 < np.mean(points >> 16 > 0) < 0.4
    assert all(3600 < cloud.size <= 4000 for cloud in clouds)
    assert len({cloud.size for cloud in clouds}) > 1


def test_the_data_set_says_that_it_is_synthetic(demo: Path) -> None:
    about = json.loads((demo / "dataset.json").read_text("utf-8"))
    assert about == {
        "title": "WildScenes demo",
        "synthetic": True,
        "note": "Made by a program from random numbers. The scores of this data set say nothing about WildScenes.",
    }


def test_trees_and_ground_make_most_of_a_forest(demo: Path) -> None:
    maps = np.stack([canonical(path) for path in (demo / "WildScenes2d").rglob("*.png")])
    share = {name: float(np.mean(maps == index)) for index, name in enumerate(WILDSCENES.names)}
    assert max(share, key=lambda name: share[name]) == "tree-foliage"
    assert sum(share[name] for name in ("tree-foliage", "tree-trunk", "grass", "dirt", "sky")) > 0.8
    heights = {
        name: np.argwhere(maps == WILDSCENES.names.index(name))[:, 1].mean() for name in ("sky", "bush", "grass")
    }
    assert heights["sky"] < heights["bush"] < heights["grass"]


@pytest.mark.parametrize("wrong", [{"frames": 0}, {"size": (31, 24)}, {"size": (32, 23)}, {"points": 199}])
def test_a_demo_that_is_too_small_for_all_classes_is_refused(tmp_path: Path, wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"^a demo needs at least 1 frame, 32 x 24 pixels and 200 points$"):
        write_demo(tmp_path, **{**SMALLEST, **wrong})
    assert contents(tmp_path) == {}


def test_a_benchmark_without_the_classes_of_a_forest_is_refused(tmp_path: Path) -> None:
    text = WILDSCENES.model_dump_json().replace('"water"', '"lava"').replace('"log"', '"lamp"')
    with pytest.raises(BenchmarkError, match=r"classes that wildscenes does not have: log, water$"):
        write_demo(tmp_path, benchmark=Benchmark.model_validate_json(text))


def mean_accuracy(truth: NDArray[np.uint8], predicted: NDArray[np.uint8]) -> float:
    return float(np.mean([np.mean(predicted[truth == c] == c) for c in np.unique(truth) if c != UNLABELLED]))


@pytest.mark.parametrize("suffix", [".png", ".label"])
def test_mean_accuracy_falls_with_quality(demo: Path, suffix: str) -> None:
    truth = [canonical(path) for path in sorted(demo.rglob(f"*{suffix}"))]
    scores = []
    for quality in (1.0, 0.9, 0.7, 0.5, 0.2, 0.0):
        rng = np.random.default_rng(1)
        predicted = [degrade(labels, quality, rng, 15).ravel() for labels in truth]
        scores.append(mean_accuracy(np.concatenate([t.ravel() for t in truth]), np.concatenate(predicted)))
    assert scores[0] == 1.0
    assert all(better - worse > 0.03 for better, worse in pairwise(scores)), scores
    assert scores[-1] < 0.3


@settings(max_examples=60, deadline=None)
@given(
    labels=arrays(
        np.uint8,
        array_shapes(min_dims=1, max_dims=2, min_side=1, max_side=40),
        elements=st.sampled_from([*range(5), UNLABELLED]),
    ),
    quality=st.floats(0, 1),
    seed=st.integers(0, 2**32),
)
def test_a_degraded_map_keeps_its_shape_and_brings_no_new_value(
    labels: NDArray[np.uint8], quality: float, seed: int
) -> None:
    before = labels.copy()
    predicted = degrade(labels, quality, np.random.default_rng(seed), 5)
    assert (predicted.shape, predicted.dtype) == (labels.shape, np.dtype(np.uint8))
    assert set(np.unique(predicted)) <= set(np.unique(labels))
    assert np.array_equal(labels, before)
    assert np.array_equal(degrade(labels, 1.0, np.random.default_rng(seed), 5), labels)


@pytest.mark.parametrize("quality", [-0.1, 1.1, float("nan")])
def test_a_quality_outside_0_to_1_is_refused(quality: float) -> None:
    with pytest.raises(ValueError, match=r"is outside \[0, 1\]$"):
        degrade(np.zeros((4, 4), np.uint8), quality, np.random.default_rng(0), 15)


def members(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        assert {entry.compress_type for entry in archive.infolist()} == {zipfile.ZIP_DEFLATED}
        assert archive.testzip() is None
        return {entry.filename: archive.read(entry) for entry in archive.infolist()}


def test_perfect_predictions_are_the_ground_truth_with_every_unlabelled_place_filled(tmp_path: Path) -> None:
    image = np.array([[255, 3, 255], [255, 14, 2]], np.uint8)
    write_predictions([("K-01", "1-2", image)], tmp_path / "i.zip", kind="image", quality=1.0, seed=0, k=15)
    ((name, data),) = members(tmp_path / "i.zip").items()
    with Image.open(BytesIO(data)) as read_back:
        assert (name, read_back.mode) == ("K-01/1-2.png", "L")
        assert np.array(read_back).tolist() == [[3, 3, 3], [3, 14, 2]]
    clouds = [("K-03", "1.2", np.array([7, 255, 0], np.uint8)), ("V-01", "1.3", np.full(2, 255, np.uint8))]
    write_predictions(clouds, tmp_path / "c.zip", kind="cloud", quality=1.0, seed=0, k=15)
    assert members(tmp_path / "c.zip") == {
        "K-03/1.2.label": bytes([7, 0, 0, 0, 7, 0, 0, 0, 0, 0, 0, 0]),
        "V-01/1.3.label": bytes(8),
    }


def test_predictions_depend_on_the_frame_and_the_seed_but_not_on_the_order(demo: Path, tmp_path: Path) -> None:
    paths = sorted((demo / "WildScenes3d" / "K-01").rglob("*.label"))[:4]
    frames = [("K-01", path.stem, canonical(path)) for path in paths]
    for name, given_frames, seed in (
        ("one", frames, 5),
        ("two", frames, 5),
        ("reversed", frames[::-1], 5),
        ("other", frames, 6),
    ):
        write_predictions(given_frames, tmp_path / name, kind="cloud", quality=0.6, seed=seed, k=15)
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()
    assert members(tmp_path / "one") == members(tmp_path / "reversed")
    assert all(data != members(tmp_path / "other")[name] for name, data in members(tmp_path / "one").items())
    values = np.frombuffer(b"".join(members(tmp_path / "one").values()), "<u4")
    assert (WILDSCENES.columns("benchmark")[values] != INVALID).all()
    assert values.max() < 15


def test_predictions_of_an_unknown_kind_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"^unknown kind 'video'$"):
        write_predictions([], tmp_path / "out.zip", kind="video", quality=1.0, seed=0, k=15)
    assert contents(tmp_path) == {}
