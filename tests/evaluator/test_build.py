"""Building packs exactly the labels of a data set, says nothing of them in public, and stops at what is wrong."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

from evaluator.benchmark import Benchmark, load
from evaluator.build import build, read_splits
from evaluator.errors import GroundTruthError
from evaluator.groundtruth import GroundTruth
from evaluator.packing import Listed

if TYPE_CHECKING:
    from tests.evaluator.conftest import Frames, Make, Planted


FRAMES = {
    "standard": (2133, 2705, 6051, 7517),
    "summer-to-summer": (1499, 2063, 3742, 4823),
    "winter-to-summer": (1499, 2063, 2309, 2694),
    "karawatha-to-karawatha": (1247, 1717, 3809, 4668),
    "venman-to-karawatha": (1247, 1717, 2242, 2849),
    "val": (283, 356, 0, 0),
}
"""The protocol's table: test frames in 2D and 3D, train frames in 2D and 3D."""


@pytest.fixture(scope="module")
def official(shared: Path) -> dict[str, list[Listed]]:
    return read_splits(shared / "wildscenes" / "splits", load())


@pytest.mark.parametrize("protocol", FRAMES)
def test_the_official_split_files_hold_the_frames_of_the_protocols_table(
    official: dict[str, list[Listed]], wildscenes: Benchmark, protocol: str
) -> None:
    tracks = [wildscenes.track(f"{modality}-{protocol}") for modality in ("2d", "3d")]
    tested = [sum(t.holds(row.split, row.sequence) for row in official[t.modality_id]) for t in tracks]
    trained = [
        sum(row.split == "train" and row.sequence in t.protocol.train_sequences for row in official[t.modality_id])
        for t in tracks
    ]
    assert (*tested, *trained) == FRAMES[protocol]


def test_the_official_val_split_is_all_of_one_sequence(official: dict[str, list[Listed]]) -> None:
    assert {row.sequence for rows in official.values() for row in rows if row.split == "val"} == {"K-01"}


def test_the_facts_say_nothing_that_comes_from_hidden_labels(
    small: Planted,
    forest: Benchmark,
    forest_frames: Frames,
    planting: Callable[..., Path],
    packing: Callable[..., Planted],
    tmp_path: Path,
) -> None:
    facts = json.loads((small.truth.folder / "facts.json").read_text("utf-8"))
    said = ["format", "benchmark", "title", "groundtruth", "open", "synthetic", "comparable", "modalities"]
    assert list(facts) == said
    for modality in facts["modalities"].values():
        assert list(modality) == ["frames", "train_shares"]
        assert all(list(frame) == ["name", "sequence", "split", "shape"] for frame in modality["frames"])
    stone = {"photo": 4, "scan": 2}
    hidden = {
        key: np.full_like(np.array(labels), stone[key[0]]) if key[1] != "train" else labels
        for key, labels in forest_frames.items()
    }
    other = packing(forest, planting(tmp_path / "data", forest, hidden), tmp_path / "out", allow_absent=True)
    said = json.loads((other.truth.folder / "facts.json").read_text("utf-8"))
    assert said["groundtruth"] != facts["groundtruth"]
    assert said | {"groundtruth": ""} == facts | {"groundtruth": ""}


def test_the_class_shares_are_those_of_the_labelled_train_pixels(demo: Planted, wildscenes: Benchmark) -> None:
    counts = np.zeros(256, np.int64)
    for path in (demo.data / "WildScenes2d").rglob("indexLabel/*.png"):
        if path.stem in (demo.splits / "opt2d" / "train.csv").read_text("utf-8"):
            counts += np.bincount(wildscenes.columns("raw19")[np.array(Image.open(path))].ravel(), minlength=256)
    shares = counts[:15] / counts[:15].sum()
    assert demo.truth.facts.modalities["2d"].train_shares == dict(zip(wildscenes.names, shares, strict=True))


def test_train_labels_that_are_missing_as_a_whole_give_null_shares(
    forest: Benchmark,
    forest_frames: Frames,
    planting: Callable[..., Path],
    packing: Callable[..., Planted],
    tmp_path: Path,
) -> None:
    data = planting(tmp_path / "data", forest, forest_frames)
    (data / "photo" / "North" / "1-000000001.png").unlink()
    packed = packing(forest, data, tmp_path / "out")
    assert packed.truth.facts.modalities["photo"].train_shares is None
    assert packed.truth.facts.modalities["scan"].train_shares is None


def test_train_labels_without_one_labelled_pixel_give_null_shares(
    forest: Benchmark,
    forest_frames: Frames,
    planting: Callable[..., Path],
    packing: Callable[..., Planted],
    tmp_path: Path,
) -> None:
    forest_frames["photo", "train", "North", "1-000000001"] = np.zeros((2, 4))
    packed = packing(forest, planting(tmp_path / "data", forest, forest_frames), tmp_path / "out")
    assert packed.truth.facts.modalities["photo"].train_shares is None


def test_the_release_counts_the_classes_of_val_and_test(small: Planted) -> None:
    assert small.truth.release.totals == {
        "photo": {"leaf": 10, "soil": 6, "stone": 4, "unlabelled": 4},
        "scan": {"leaf": 4, "soil": 4, "stone": 2, "unlabelled": 1},
    }


def test_the_digest_does_not_depend_on_the_order_of_the_split_files(
    small: Planted,
    forest: Benchmark,
    forest_frames: Frames,
    planting: Callable[..., Path],
    packing: Callable[..., Planted],
    tmp_path: Path,
) -> None:
    turned = dict(reversed(forest_frames.items()))
    other = packing(forest, planting(tmp_path / "data", forest, turned), tmp_path / "out")
    ours, theirs = small.truth.release.modalities["photo"], other.truth.release.modalities["photo"]
    assert [one.name for one in ours] == ["2-000000001", "3-000000001", "4-000000001"]
    assert [one.name for one in theirs] == ["2-000000001", "4-000000001", "3-000000001"]
    assert other.truth.digest == small.truth.digest


def test_building_again_gives_the_same_bytes(small: Planted, tmp_path: Path) -> None:
    build(small.data, small.splits, tmp_path / "again", small.benchmark)
    for file in small.truth.folder.iterdir():
        assert (tmp_path / "again" / file.name).read_bytes() == file.read_bytes()


def test_a_release_is_hidden_unless_it_is_built_open(small: Planted, tmp_path: Path) -> None:
    assert not small.truth.facts.open
    assert build(small.data, small.splits, tmp_path / "open", small.benchmark, is_open=True).open
    opened = GroundTruth(tmp_path / "open", small.benchmark)
    assert (opened.facts.open, opened.digest) == (True, small.truth.digest)


def test_a_synthetic_data_set_is_named_and_never_comparable(demo: Planted) -> None:
    facts = demo.truth.facts
    assert (facts.title, facts.synthetic, facts.comparable) == ("WildScenes demo", True, False)


def test_progress_counts_every_file(small: Planted, tmp_path: Path) -> None:
    steps = []
    build(small.data, small.splits, tmp_path / "out", small.benchmark, progress=lambda *step: steps.append(step))
    assert steps == [(done, 6) for done in range(1, 7)]


@pytest.fixture
def refusal(
    forest: Benchmark, forest_frames: Frames, planting: Callable[..., Path], tmp_path: Path
) -> Callable[..., str]:
    """Why a data set cannot be packed, after a change of its frames or of the folder; nothing may be left behind."""

    def refused(frames: Frames | None = None, change: Callable[[Path], object] = lambda _: None, **options: Any) -> str:
        data = planting(tmp_path / "data", forest, forest_frames | (frames or {}))
        change(data)
        with pytest.raises(GroundTruthError) as caught:
            build(data, data / "splits", tmp_path / "out", forest, **options)
        assert not (tmp_path / "out").exists()
        return str(caught.value)

    return refused


def test_a_value_outside_the_encoding_names_the_file_the_value_and_how_often(refusal: Callable[..., str]) -> None:
    assert refusal({("photo", "test", "South", "4-000000001"): [[2, 2, 1, 1], [9, 3, 4, 254]]}) == (
        "photo/South/4-000000001.png: values outside encoding 'ids': 2 (2 times), 9 (1 times), 254 (1 times)"
    )


def test_a_point_above_255_is_outside_any_encoding_and_its_upper_bits_are_not_looked_at(
    refusal: Callable[..., str],
) -> None:
    assert refusal({("scan", "test", "South", "4-000000001"): [0, 256, 256, 65535, (7 << 16) | 1]}) == (
        "scan/South/4-000000001.label: values outside encoding 'benchmark': 256 (2 times), 65535 (1 times)"
    )


def test_values_are_checked_in_train_labels_too(refusal: Callable[..., str]) -> None:
    assert refusal({("photo", "train", "North", "1-000000001"): [[5]]}) == (
        "photo/North/1-000000001.png: values outside encoding 'ids': 5 (1 times)"
    )


def test_a_label_file_that_is_no_label_map_is_named(refusal: Callable[..., str], make: type[Make]) -> None:
    def paint(data: Path) -> None:
        (data / "photo" / "South" / "4-000000001.png").write_bytes(make.png(np.zeros((2, 4)), mode="RGB"))

    assert refusal(change=paint) == (
        "ground truth photo/South/4-000000001.png: not_indices (expected 8-bit greyscale or a palette of indices, "
        "found 8-bit RGB). This looks painted; save the class indices as an 8-bit greyscale or palette PNG."
    )


def test_missing_files_are_counted_and_the_first_five_named(refusal: Callable[..., str]) -> None:
    frames = {("photo", "test", "North", f"9-{i}"): [[1]] for i in range(7)}

    def lose(data: Path) -> None:
        for i in range(7):
            (data / "photo" / "North" / f"9-{i}.png").unlink()

    said = refusal(frames, lose)
    listed = ", ".join(f"photo/North/9-{i}.png" for i in range(5))
    assert said.startswith("7 label files are missing below ")
    assert said.endswith(f"/data: {listed}, …")


def test_train_labels_may_not_be_missing_in_part(refusal: Callable[..., str]) -> None:
    more = {("photo", "train", "North", "1-000000002"): [[1]]}
    said = refusal(more, lambda data: (data / "photo" / "North" / "1-000000002.png").unlink())
    assert said.startswith("1 label files are missing below ")
    assert said.endswith("/data: photo/North/1-000000002.png")


def test_a_ranked_track_in_which_a_scored_class_is_absent_is_refused(refusal: Callable[..., str]) -> None:
    frames = {
        ("photo", "test", "North", "3-000000001"): [[1, 3]],
        ("photo", "test", "South", "4-000000001"): [[1, 3]],
        ("photo", "val", "North", "2-000000001"): [[1, 4]],
        ("scan", "test", "North", "3-000000001"): [2],
        ("scan", "test", "South", "4-000000001"): [0, 2],
    }
    assert refusal(frames) == (
        "scored classes without ground truth (rows of one board would be means over different classes; "
        "--allow-absent accepts that for a trial): photo-whole: stone; scan-whole: soil"
    )


def test_allow_absent_accepts_that(
    forest: Benchmark,
    forest_frames: Frames,
    planting: Callable[..., Path],
    packing: Callable[..., Planted],
    tmp_path: Path,
) -> None:
    forest_frames["scan", "test", "North", "3-000000001"] = [2]
    forest_frames["scan", "test", "South", "4-000000001"] = [2]
    packed = packing(forest, planting(tmp_path / "data", forest, forest_frames), tmp_path / "out", allow_absent=True)
    assert packed.truth.release.totals["scan"] == {"leaf": 0, "soil": 0, "stone": 2, "unlabelled": 0}


def test_a_folder_that_holds_anything_is_not_overwritten(small: Planted, tmp_path: Path) -> None:
    (tmp_path / "note").touch()
    with pytest.raises(GroundTruthError, match=" is not empty$"):
        build(small.data, small.splits, tmp_path, small.benchmark)
    assert [path.name for path in tmp_path.iterdir()] == ["note"]


def test_an_empty_folder_is_taken(small: Planted, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    assert build(small.data, small.splits, tmp_path / "out", small.benchmark).groundtruth == small.truth.digest


def test_a_folder_without_split_files_is_refused(forest: Benchmark, tmp_path: Path) -> None:
    with pytest.raises(GroundTruthError) as caught:
        read_splits(tmp_path, forest)
    assert str(caught.value) == f"{tmp_path} has no split files: expected photos/test.csv or scans/test.csv"


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (["id,im_path", "1-2,x"], "needs the columns id and label_path"),
        (["id,label_path", "1-2,"], "needs the columns id and label_path"),
        (["id,label_path", "1-2,/photo/North/1-2.png"], "/photo/North/1-2.png leaves the data set's folder"),
        (["id,label_path", "1-2,photo/../North/1-2.png"], "photo/../North/1-2.png leaves the data set's folder"),
        (["id,label_path", "1-2,photo/East/1-2.png"], "photo/East/1-2.png names no sequence of North, South"),
        (["id,label_path", "1-2,North/South/1-2.png"], "North/South/1-2.png names no sequence of North, South"),
        (["id,label_path", "1-2,North/a.png", "1.2,South/b.png"], "the photo split files list frame 1-2 twice"),
    ],
)
def test_a_split_file_that_cannot_be_followed_is_refused(
    forest: Benchmark, tmp_path: Path, lines: list[str], said: str
) -> None:
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "test.csv").write_text("\n".join(lines), "utf-8")
    with pytest.raises(GroundTruthError) as caught:
        read_splits(tmp_path, forest)
    assert str(caught.value).endswith(said)
