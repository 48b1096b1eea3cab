"""Whatever is wrong with a submission is said at once: which member, which rule, what was there and what to do."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from evaluator.benchmark import Benchmark
from evaluator.errors import HINTS, Code
from evaluator.evaluate import Outcome, evaluate

if TYPE_CHECKING:
    from tests.evaluator.conftest import Make, Planted

pytestmark = pytest.mark.usefixtures("either_path")


Said = dict[str, str | None]
"""A problem or a warning as JSON."""

PHOTOS = {"3-000000001.png": [[0, 1, 2, 0], [0, 1, 2, 2]], "4-000000001.png": [[0, 0, 0, 0], [1, 1, 2, 0]]}
SCANS = {"3-000000001.label": [0, 1, 2, 0, 0, 1], "4-000000001.label": [0, 0, 1, 1, 2]}
SHIFTED = "0 seems to be 'unlabelled' here and every index one too high: subtract 1, and write 255 where it was 0."
IDS = "These labels look like 'ids': send them again with labels=ids."


def problem(
    code: Code, member: str | None, expected: str | None = None, found: str | None = None, hint: str | None = None
) -> Said:
    return {"member": member, "code": code.value, "expected": expected, "found": found, "hint": hint or HINTS[code]}


@pytest.fixture
def outcome(small: Planted, make: type[Make], tmp_path: Path) -> Callable[..., Outcome]:
    """Score photos or scans, some members replaced by bytes or by labels."""

    def run(track_id: str = "photo-whole", encoding: str = "benchmark", /, **changed: Any) -> Outcome:
        kind = small.benchmark.track(track_id).modality.kind
        members: dict[str, Any] = dict(PHOTOS if kind == "image" else SCANS)
        members |= {f"{key[1]}-000000001.{'png' if kind == 'image' else 'label'}": changed[key] for key in changed}
        files = {name: make.labels(one, kind) if isinstance(one, list) else one for name, one in members.items()}
        return small.score(make.zip(tmp_path / "one.zip", files), track_id, encoding)

    return run


def problems(outcome: Outcome) -> list[Said]:
    return [one.as_json() for one in outcome.problems]


def test_the_ground_truth_itself_has_no_problem(outcome: Callable[..., Outcome]) -> None:
    for track_id in ("photo-whole", "scan-whole"):
        assert (outcome(track_id).problems, outcome(track_id).warnings) == ((), ())


def test_an_archive_that_is_refused_says_only_that(small: Planted, tmp_path: Path) -> None:
    path = tmp_path / "no.zip"
    path.write_bytes(b"PNG")
    found = small.score(path, "photo-whole")
    assert problems(found) == [problem(Code.NOT_A_ZIP, None, "a zip archive", "another kind of file")]
    assert (found.valid, found.frames, found.confusion.shape, found.warnings) == (False, (), (0, 3, 4), ())


def test_more_members_than_the_benchmark_allows_refuse_the_archive(
    small: Planted, make: type[Make], tmp_path: Path
) -> None:
    found = small.score(make.zip(tmp_path / "many.zip", {str(i): b"" for i in range(61)}), "photo-whole")
    assert problems(found) == [problem(Code.TOO_MANY_MEMBERS, None, "at most 60", "61")]


def test_a_value_out_of_range_is_named_with_how_often_it_occurs(outcome: Callable[..., Outcome]) -> None:
    assert problems(outcome(_3=[[0, 7, 7, 0], [0, 254, 2, 255]])) == [
        problem(Code.VALUE_OUT_OF_RANGE, "3-000000001.png", "benchmark labels 0-2 or 255", "7 (2 times), 254 (1 times)")
    ]


def test_many_values_out_of_range_are_shortened(outcome: Callable[..., Outcome]) -> None:
    assert problems(outcome("scan-whole", _3=[9, 10, 11, 12, 13, 14], _4=[20, 21, 22, 23, 300])) == [
        problem(
            Code.VALUE_OUT_OF_RANGE,
            "3-000000001.label",
            "benchmark labels 0-2 or 255",
            "9 (1 times), 10 (1 times), 11 (1 times), 12 (1 times), 13 (1 times), 14 (1 times)",
        ),
        problem(
            Code.VALUE_OUT_OF_RANGE,
            "4-000000001.label",
            "benchmark labels 0-2 or 255",
            "20 (1 times), 21 (1 times), 22 (1 times), 23 (1 times), 300 (1 times)",
        ),
    ]


def test_more_than_eight_values_out_of_range_are_counted(demo: Planted, make: type[Make], tmp_path: Path) -> None:
    sequence, frame = next(iter(demo.answers("3d-standard")))
    labels = demo.answers("3d-standard")[sequence, frame].astype(np.uint32)
    labels[:10] = np.arange(1000, 1010)
    files = demo.flat("3d-standard") | {f"{frame}.label": make.cloud(labels)}
    found = problems(demo.score(make.zip(tmp_path / "many.zip", files), "3d-standard"))
    listed = ", ".join(f"{value} (1 times)" for value in range(1000, 1008))
    expected = "benchmark labels 0-14 or 255"
    assert found == [problem(Code.VALUE_OUT_OF_RANGE, f"{frame}.label", expected, f"{listed}, and 2 more values")]


def test_a_point_above_255_is_out_of_range_and_never_taken_for_its_low_byte(outcome: Callable[..., Outcome]) -> None:
    assert problems(outcome("scan-whole", _3=[256, 257, 511, 65535, 256, 5])) == [
        problem(
            Code.VALUE_OUT_OF_RANGE,
            "3-000000001.label",
            "benchmark labels 0-2 or 255",
            "5 (1 times), 256 (2 times), 257 (1 times), 511 (1 times), 65535 (1 times)",
        )
    ]


def test_the_upper_16_bits_of_a_point_change_nothing(outcome: Callable[..., Outcome]) -> None:
    plain = outcome("scan-whole")
    instances = outcome("scan-whole", _3=[label | (9 << 16) for label in SCANS["3-000000001.label"]])
    np.testing.assert_array_equal(instances.confusion, plain.confusion)
    assert instances.valid


def test_an_index_that_the_named_encoding_skips_is_out_of_range(outcome: Callable[..., Outcome]) -> None:
    assert problems(outcome("photo-whole", "ids", _4=[[0, 0, 0, 1]] * 2)) == [
        problem(Code.VALUE_OUT_OF_RANGE, "3-000000001.png", "ids labels 0-4 or 255", "2 (3 times)")
    ]


def test_every_index_one_too_high_is_told_to_subtract_one(outcome: Callable[..., Outcome]) -> None:
    assert problems(outcome(_3=[[1, 2, 3, 0], [1, 2, 3, 3]], _4=[[1, 1, 1, 1], [2, 2, 3, 0]])) == [
        problem(Code.VALUE_OUT_OF_RANGE, f"{frame}-000000001.png", "benchmark labels 0-2 or 255", found, SHIFTED)
        for frame, found in [(3, "3 (3 times)"), (4, "3 (1 times)")]
    ]


def test_the_data_sets_own_indices_are_told_to_name_their_encoding(outcome: Callable[..., Outcome]) -> None:
    assert problems(outcome(_3=[[1, 3, 4, 0], [1, 3, 4, 4]])) == [
        problem(
            Code.VALUE_OUT_OF_RANGE, "3-000000001.png", "benchmark labels 0-2 or 255", "3 (2 times), 4 (3 times)", IDS
        )
    ]


def test_released_2d_labels_are_told_to_name_raw19(demo: Planted, make: type[Make], tmp_path: Path) -> None:
    files = {f"{frame}.png": path.read_bytes() for _, frame, path in demo.rows("2d-standard")}
    found = problems(demo.score(make.zip(tmp_path / "raw.zip", files), "2d-standard"))
    assert {(one["code"], one["expected"], one["hint"]) for one in found} == {
        (
            "value_out_of_range",
            "benchmark labels 0-14 or 255",
            "These labels look like 'raw19': send them again with labels=raw19.",
        )
    }


def test_unmapped_labels_of_the_official_3d_configuration_are_legal_but_warned_of(
    demo: Planted, make: type[Make], tmp_path: Path
) -> None:
    unmapped = np.full(256, 255, np.uint8)
    for value, canonical in enumerate([0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 12, 13]):
        unmapped[canonical] = value
    archive = make.zip(tmp_path / "13.zip", demo.flat("3d-standard", lambda labels: unmapped[labels]))
    found = demo.score(archive, "3d-standard")
    assert found.valid
    assert [one.as_json() for one in found.warnings] == [
        problem(
            Code.LOOKS_LIKE_OTHER_ENCODING,
            None,
            "benchmark",
            "10 occurs, 13 never",
            "These labels look like 'mmdet3d13', in which 10 is structure and not sky. "
            "If so, send them again with labels=mmdet3d13.",
        )
    ]
    named = demo.score(archive, "3d-standard", "mmdet3d13")
    assert (named.problems, named.warnings) == ((), ())


def test_a_large_picture_in_colours_is_told_to_save_indices_and_not_that_it_is_large(
    outcome: Callable[..., Outcome], make: type[Make]
) -> None:
    noise = np.random.default_rng(1).integers(0, 256, (800, 800, 3))
    assert problems(outcome(_3=make.png(noise, mode="RGB"))) == [
        problem(Code.NOT_INDICES, "3-000000001.png", "8-bit greyscale or a palette of indices", "8-bit RGB")
    ]


def test_a_large_file_whose_header_is_fine_is_refused_by_its_size(
    outcome: Callable[..., Outcome], make: type[Make]
) -> None:
    padding = make.chunk(b"tEXt", bytes(1 << 20))
    whole = make.raw_png((4, 2), bytes(10), extra=padding)
    assert problems(outcome(_3=whole)) == [
        problem(Code.UNREADABLE, "3-000000001.png", "at most 1048586 bytes", f"{len(whole)} bytes")
    ]


def test_a_cloud_with_fewer_points_is_told_to_map_them_back(outcome: Callable[..., Outcome]) -> None:
    assert problems(outcome("scan-whole", _3=[0, 1])) == [
        problem(Code.WRONG_POINT_COUNT, "3-000000001.label", "6 points", "2 points")
    ]


def test_without_frames_only_layout_decoding_and_values_are_checked_and_that_is_said(
    small: Planted, make: type[Make], tmp_path: Path
) -> None:
    files = {"any.png": make.png([[9]]), "South/3-000000001.png": make.png([[1]]), "README": b""}
    found = evaluate(make.zip(tmp_path / "any.zip", files), small.task("photo-whole"), None)
    assert problems(found) == [
        problem(Code.VALUE_OUT_OF_RANGE, "any.png", "benchmark labels 0-2 or 255", "9 (1 times)")
    ]
    assert [one.as_warning() for one in found.warnings] == [
        {"member": None, "code": "checked_without_facts", "hint": HINTS[Code.CHECKED_WITHOUT_FACTS]},
        {"member": "README", "code": "unknown_member", "hint": HINTS[Code.UNKNOWN_MEMBER]},
    ]


def forty(make: type[Make]) -> Iterator[tuple[Code, str, list[tuple[str, bytes]]]]:
    """Forty frames, each wrong in one of ten ways: the code to expect, the frame's name, and its members."""
    right = make.png([[0, 1]])
    ways: list[tuple[Code, Callable[[str], list[tuple[str, bytes]]]]] = [
        (Code.MISSING_FRAME, lambda _: []),
        (Code.WRONG_SEQUENCE, lambda name: [(f"South/{name}.png", right)]),
        (Code.WRONG_TYPE, lambda name: [(f"{name}.npy", right)]),
        (Code.DUPLICATE_FRAME, lambda name: [(f"a/{name}.png", right), (f"b/{name}.png", right)]),
        (Code.WRONG_SIZE, lambda name: [(f"{name}.png", make.png([[0], [1]]))]),
        (Code.UNREADABLE, lambda name: [(f"{name}.png", right[:-20])]),
        (Code.UNREADABLE, lambda name: [(f"{name}.png", b"")]),
        (Code.NOT_INDICES, lambda name: [(f"{name}.png", make.png([[0, 1]], mode="RGB"))]),
        (Code.INTERLACED, lambda name: [(f"{name}.png", make.raw_png((2, 1), bytes(3), interlaced=True))]),
        (Code.VALUE_OUT_OF_RANGE, lambda name: [(f"{name}.png", make.png([[3, 1]]))]),
    ]
    for number in range(40):
        code, members = ways[number % 10]
        name = f"{number + 1}-000000000"
        yield code, name, members(name)


def test_forty_different_things_that_are_wrong_are_all_named_in_one_answer(
    forest: Benchmark, make: type[Make], planting: Callable[..., Path], packing: Callable[..., Planted], tmp_path: Path
) -> None:
    wrong = list(forty(make))
    frames = {("photo", "test", "North", name): [[1, 3]] for _, name, _ in wrong}
    packed = packing(forest, planting(tmp_path / "data", forest, frames), tmp_path / "out", allow_absent=True)
    archive = make.zip(tmp_path / "forty.zip", [member for _, _, members in wrong for member in members])
    for jobs in (1, 4):
        found = packed.score(archive, "photo-whole", jobs=jobs)
        named = {str(one.member).split("/")[-1].rsplit(".", 1)[0]: one.code for one in found.problems}
        assert named == {name: code for code, name, _ in wrong}
        assert (len(found.problems), found.warnings) == (40, ())


def test_a_stored_archive_has_the_same_problems_as_a_deflated_one(
    small: Planted, make: type[Make], tmp_path: Path
) -> None:
    files = {"3-000000001.png": b"\x89PNG", "4-000000001.png": make.png([[0]])}
    found = [
        problems(small.score(make.zip(tmp_path / f"{method}.zip", files, method), "photo-whole"))
        for method in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
    ]
    assert found[0] == found[1]
    assert len(found[0]) == 2
