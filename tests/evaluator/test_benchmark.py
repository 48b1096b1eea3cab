"""The benchmark definition says what the protocol says, and refuses what contradicts itself."""

from __future__ import annotations

import csv
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest

from evaluator.benchmark import Benchmark, load
from evaluator.definition import Baseline
from evaluator.errors import BenchmarkError

CLASSES = {
    "bush": (230, 25, 75),
    "dirt": (60, 180, 75),
    "fence": (0, 128, 128),
    "grass": (128, 128, 128),
    "gravel": (145, 30, 180),
    "log": (128, 128, 0),
    "mud": (255, 225, 25),
    "other-object": (250, 190, 190),
    "other-terrain": (70, 240, 240),
    "rock": (170, 255, 195),
    "sky": (0, 0, 128),
    "structure": (170, 110, 40),
    "tree-foliage": (210, 245, 60),
    "tree-trunk": (240, 50, 230),
    "water": (0, 130, 200),
}
VOID, NONE = 15, 254
ENCODINGS = {
    "benchmark": [*range(15)],
    "raw19": [VOID, 8, 1, 6, 14, 4, 8, 13, 12, 0, 2, 11, 7, VOID, 9, 5, 7, 10, 3],
    "mmdet3d13": [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 12, 13],
}
SHIFT_2D, STANDARD_3D = {"fence", "gravel", "other-terrain"}, {"sky", "water", "other-terrain"}
NOT_SCORED = {
    "2d-standard": set(),
    "2d-summer-to-summer": SHIFT_2D,
    "2d-winter-to-summer": SHIFT_2D,
    "2d-karawatha-to-karawatha": SHIFT_2D,
    "2d-venman-to-karawatha": SHIFT_2D,
    "2d-val": set(),
    "3d-standard": STANDARD_3D,
    "3d-summer-to-summer": SHIFT_2D | STANDARD_3D,
    "3d-winter-to-summer": SHIFT_2D | STANDARD_3D,
    "3d-karawatha-to-karawatha": SHIFT_2D | STANDARD_3D,
    "3d-venman-to-karawatha": SHIFT_2D | STANDARD_3D,
    "3d-val": STANDARD_3D,
}
SUMMER, KARAWATHA = {"V-03", "K-03"}, {"K-01", "K-03"}
ALL = {"V-01", "V-02", "V-03", "K-01", "K-03"}
PROTOCOLS = {
    "standard": ("test", ALL, ALL, True, {"2d": 2133, "3d": 2705}),
    "summer-to-summer": ("test", SUMMER, SUMMER, True, {"2d": 1499, "3d": 2063}),
    "winter-to-summer": ("test", SUMMER, ALL - SUMMER, True, {"2d": 1499, "3d": 2063}),
    "karawatha-to-karawatha": ("test", KARAWATHA, KARAWATHA, True, {"2d": 1247, "3d": 1717}),
    "venman-to-karawatha": ("test", KARAWATHA, ALL - KARAWATHA, True, {"2d": 1247, "3d": 1717}),
    "val": ("val", {"K-01"}, set(), False, {"2d": 283, "3d": 356}),
}
BASELINES = load().baselines
FIRST_PRINTED_IN_TABLE_3 = {"DeepLabv3": ("ImageNet weights",), "SPVCNN": ("random weights",)}


def test_the_classes_and_their_colours_are_the_protocols(wildscenes: Benchmark) -> None:
    assert [(one.name, one.color) for one in wildscenes.classes] == list(CLASSES.items())


def test_the_definition_has_exactly_the_encodings_of_the_protocol(wildscenes: Benchmark) -> None:
    assert set(wildscenes.encodings) == set(ENCODINGS)


@pytest.mark.parametrize("name", ENCODINGS)
def test_an_encoding_sends_each_value_to_its_class_or_void_and_the_rest_nowhere(
    wildscenes: Benchmark, name: str
) -> None:
    expected = np.full(256, NONE, np.uint8)
    expected[: len(ENCODINGS[name])] = ENCODINGS[name]
    expected[255] = VOID
    np.testing.assert_array_equal(wildscenes.columns(name), expected)


def test_an_index_that_an_encoding_skips_is_none_of_its_values(forest: Benchmark) -> None:
    assert forest.columns("ids")[:6].tolist() == [3, 0, NONE, 1, 2, NONE]


def test_the_protocols_train_and_test_on_the_sequences_of_the_table(wildscenes: Benchmark) -> None:
    assert {
        one.id: (one.split, set(one.test_sequences), set(one.train_sequences), one.ranked, one.frames)
        for one in wildscenes.protocols
    } == PROTOCOLS


def test_each_track_leaves_out_the_classes_of_the_table(wildscenes: Benchmark) -> None:
    assert {
        track.id: set(CLASSES) - {wildscenes.names[i] for i in track.scored} for track in wildscenes.all_tracks.values()
    } == NOT_SCORED


@pytest.mark.parametrize("track_id", NOT_SCORED)
def test_only_3d_has_an_official_mean_which_adds_other_terrain(wildscenes: Benchmark, track_id: str) -> None:
    track = wildscenes.track(track_id)
    other_terrain = 8
    assert track.official == (() if track_id.startswith("2d") else tuple(sorted({*track.scored, other_terrain})))


def test_the_ground_truth_of_images_is_raw_and_that_of_clouds_is_not(wildscenes: Benchmark) -> None:
    assert {m: one.groundtruth_encoding for m, one in wildscenes.modalities.items()} == {
        "2d": "raw19",
        "3d": "benchmark",
    }


def test_the_sequences_are_those_of_the_paper(wildscenes: Benchmark, shared: Path) -> None:
    with (shared / "paper" / "traversals.csv").open(newline="", encoding="utf-8") as stream:
        rows = [(row["sequence"], row["environment"], row["date"], row["season"]) for row in csv.DictReader(stream)]
    assert [(one.name, one.environment, one.date, one.season) for one in wildscenes.sequences] == rows


def test_there_are_nineteen_baselines_nine_of_table_3_eight_of_table_4_and_two_new_ones_of_table_5() -> None:
    assert [one.table for one in BASELINES] == [3] * 9 + [4] * 8 + [5] * 2


@pytest.mark.parametrize("row", BASELINES, ids=lambda row: f"{row.track} {row.title} {row.note}".strip())
def test_a_baseline_has_each_scored_class_and_its_printed_mean_is_their_mean(
    row: Baseline, wildscenes: Benchmark
) -> None:
    assert set(row.iou) == {wildscenes.names[i] for i in wildscenes.track(row.track).scored}
    mean = sum((Decimal(str(iou)) for iou in row.iou.values()), Decimal()) / len(row.iou)
    assert mean.quantize(Decimal("0.01")) == Decimal(f"{row.miou:.2f}")


@pytest.mark.parametrize(
    ("file", "table"), [("table3_benchmark", 3), ("table4_domain_shift", 4), ("table5_pretraining", 5)]
)
def test_the_baselines_are_the_rows_of_the_papers_tables(file: str, table: int, shared: Path) -> None:
    with (shared / "paper" / f"{file}.csv").open(newline="", encoding="utf-8") as stream:
        printed = list(csv.DictReader(stream))
    assert len(printed) == {3: 9, 4: 8, 5: 4}[table]
    for row in printed:
        iou = {name: float(row[name]) for name in CLASSES if row[name]}
        mean = sum((Decimal(row[name]) for name in iou), Decimal()) / len(iou)
        assert mean.quantize(Decimal("0.01")) == Decimal(row["miou"])
        same = [one for one in BASELINES if (one.track, one.method, one.iou) == (row["track"], row["method"], iou)]
        assert [one.miou for one in same] == [float(row["miou"])]
        weights = row.get("initial_weights", "")
        first = 3 if weights in FIRST_PRINTED_IN_TABLE_3.get(row["method"], ()) else table
        assert (same[0].table, same[0].note) == (first, f"pre-training ablation: {weights}" if first == 5 else "")
        assert same[0].backbone == row.get("backbone", same[0].backbone)


def test_an_unknown_track_is_refused_with_those_that_exist(forest: Benchmark) -> None:
    with pytest.raises(BenchmarkError) as caught:
        forest.track("2d-standard")
    assert str(caught.value) == "unknown track '2d-standard'; there are: photo-whole, photo-practice, scan-whole"


def test_an_unknown_encoding_is_refused_with_those_that_exist(forest: Benchmark) -> None:
    with pytest.raises(BenchmarkError) as caught:
        forest.columns("raw19")
    assert str(caught.value) == "unknown label encoding 'raw19'; there are: benchmark, ids, two"


def write(path: Path, forest_text: str, *changes: tuple[str, str]) -> Path:
    for old, new in changes:
        assert old in forest_text
        forest_text = forest_text.replace(old, new)
    path.write_text(forest_text, "utf-8")
    return path


@pytest.fixture
def text(request: pytest.FixtureRequest) -> str:
    return (request.path.parent / "forest.toml").read_text("utf-8")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('values = ["soil", "stone"]', 'values = ["soil", "sand"]', "encoding two: class sand"),
        ('suspects = ["ids"]', 'suspects = ["odd"]', "modality photo: encoding odd"),
        ('test_sequences = ["North"]', 'test_sequences = ["East"]', "protocol practice: sequence East"),
        ('scan = ["stone"]', 'scan = ["sand"]', "protocol whole: class sand"),
        ('modality = "scan"', 'modality = "sound"', "track scan-whole: modality sound"),
        ('protocol = "practice"', 'protocol = "drill"', "track photo-practice: protocol drill"),
        ('id = "photo-practice"', 'id = "photo-whole"', "two tracks share an id"),
        ('name = "soil"', 'name = "leaf"', "two classes share a name"),
    ],
)
def test_a_name_that_is_not_defined_is_named(text: str, tmp_path: Path, old: str, new: str, said: str) -> None:
    with pytest.raises(BenchmarkError, match=said):
        load(write(tmp_path / "forest.toml", text, (old, new)))


def test_a_baseline_must_name_a_track_and_classes_that_exist(text: str, tmp_path: Path) -> None:
    row = (
        '[[baselines]]\ntrack = "sky"\nmethod = "Net"\nbackbone = "R50"\ntable = 1\nmiou = 1.0\niou = { sand = 1.0 }\n'
    )
    with pytest.raises(BenchmarkError) as caught:
        load(write(tmp_path / "forest.toml", text + row))
    assert "baseline Net (R50): track sky; baseline Net (R50): class sand" in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("format = 1", "format = 2", "format: "),
        ("color = [0, 200, 0]", "color = [0, 256, 0]", r"classes\.0\.color\.1: "),
        ('title = "Forest"', 'title = "Forest"\nversion = 3', "version: Extra inputs are not permitted"),
        ('kind = "image"', 'kind = "video"', r"modalities\.photo\.kind: "),
        ('id = "forest"', 'id = "a forest"', "id: "),
        ("max_members = 60", 'max_members = "60"', r"limits\.max_members: "),
    ],
)
def test_a_field_that_is_not_valid_is_named(text: str, tmp_path: Path, old: str, new: str, said: str) -> None:
    with pytest.raises(BenchmarkError, match=rf"forest\.toml is not valid: .*{said}"):
        load(write(tmp_path / "forest.toml", text, (old, new)))


@pytest.mark.parametrize("content", [b"format = ", b"\xff\xfe"])
def test_a_file_that_is_no_toml_cannot_be_read(content: bytes, tmp_path: Path) -> None:
    file = tmp_path / "odd.toml"
    file.write_bytes(content)
    with pytest.raises(BenchmarkError, match=r"^cannot read the benchmark definition .*odd\.toml: "):
        load(file)


def test_a_file_that_does_not_exist_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(BenchmarkError, match=r"^cannot read the benchmark definition .*none\.toml: "):
        load(tmp_path / "none.toml")
