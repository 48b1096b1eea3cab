"""Members find their frames by name in any layout, and every name that is wrong is reported."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from evaluator.archive import Member
from evaluator.benchmark import Benchmark
from evaluator.errors import HINTS, Code
from evaluator.frames import Frame
from evaluator.matching import Matched, match, match_unknown

Said = dict[str, str | None]
"""A problem or a warning as JSON."""

FRAMES = (
    Frame(name="1623370893-376340233", sequence="V-02", split="test", shape=(5,)),
    Frame(name="1624326819-383071121", sequence="K-01", split="test", shape=(4,)),
)
STEMS = ("1623370893-376340233", "1624326819-383071121")


def members(*names: str) -> list[Member]:
    return [Member(name, 1, position) for position, name in enumerate(names)]


def problem(code: Code, member: str | None, expected: str | None = None, found: str | None = None) -> Said:
    return {"member": member, "code": code.value, "expected": expected, "found": found, "hint": HINTS[code]}


@pytest.fixture(scope="session")
def pair(wildscenes: Benchmark) -> Callable[..., Matched]:
    """Match names with the two frames, on a track of clouds or of images."""

    def run(*names: str, track: str = "3d-standard") -> Matched:
        return match(members(*names), FRAMES, wildscenes.track(track), wildscenes)

    return run


def reported(matched: Matched) -> tuple[list[Said], list[Said]]:
    return [one.as_json() for one in matched.problems], [one.as_warning() for one in matched.warnings]


LAYOUTS = ["", "{s}/", "WildScenes3d/{s}/Labels/", "sequences/{s}/predictions/", "my run/{s}/", "a/b/c/", "{s}\\"]


@given(
    layouts=st.lists(st.sampled_from(LAYOUTS), min_size=2, max_size=2),
    extensions=st.lists(st.sampled_from([".label", ".LABEL", ".Label"]), min_size=2, max_size=2),
    dashes=st.lists(st.sampled_from("-."), min_size=2, max_size=2),
    turned=st.booleans(),
)
def test_any_layout_and_any_spelling_of_a_frame_finds_it(
    pair: Callable[..., Matched], layouts: list[str], extensions: list[str], dashes: list[str], *, turned: bool
) -> None:
    names = [
        layout.format(s=frame.sequence) + frame.name.replace("-", dash) + extension
        for frame, layout, dash, extension in zip(FRAMES, layouts, dashes, extensions, strict=True)
    ]
    found = pair(*(reversed(names) if turned else names))
    assert [(frame, member.name) for frame, member in found.pairs] == list(zip(FRAMES, names, strict=True))
    assert reported(found) == ([], [])


def test_what_operating_systems_leave_behind_is_ignored_without_a_word(pair: Callable[..., Matched]) -> None:
    junk = ["__MACOSX/V-02/._1623370893-376340233.label", "V-02/.DS_Store", "Thumbs.db", "K-01/desktop.ini"]
    found = pair(*junk, *(f"{stem}.label" for stem in STEMS))
    assert [member.position for _, member in found.pairs] == [4, 5]
    assert reported(found) == ([], [])


def test_a_member_that_is_no_frame_of_the_track_is_a_warning(pair: Callable[..., Matched]) -> None:
    found = pair("README.md", "1600000000-000000001.label", *(f"{stem}.label" for stem in STEMS))
    hint = HINTS[Code.UNKNOWN_MEMBER]
    assert reported(found) == (
        [],
        [
            {"member": "README.md", "code": "unknown_member", "hint": hint},
            {"member": "1600000000-000000001.label", "code": "unknown_member", "hint": hint},
        ],
    )


def test_each_missing_frame_is_a_problem_with_its_sequence(pair: Callable[..., Matched]) -> None:
    assert reported(pair()) == (
        [
            problem(Code.NO_FRAME_NAMED, None, "names such as V-02/1623370893-376340233.label", "no file at all"),
            problem(Code.MISSING_FRAME, "V-02/1623370893-376340233.label", "a member of this name", "none"),
            problem(Code.MISSING_FRAME, "K-01/1624326819-383071121.label", "a member of this name", "none"),
        ],
        [],
    )


def test_names_with_a_prefix_are_told_once_what_a_name_is(pair: Callable[..., Matched]) -> None:
    problems, warnings = reported(pair(*(f"pred_{stem}.label" for stem in STEMS)))
    expected = "names such as V-02/1623370893-376340233.label"
    assert problems[0] == problem(Code.NO_FRAME_NAMED, None, expected, f"pred_{STEMS[0]}.label")
    assert [one["code"] for one in problems[1:] + warnings] == ["missing_frame"] * 2 + ["unknown_member"] * 2
    assert reported(pair(f"{STEMS[0]}.label"))[0][0]["code"] == "missing_frame"


def test_two_members_that_claim_one_frame_are_named_together(pair: Callable[..., Matched]) -> None:
    found = pair("a/1623370893-376340233.label", "b/1623370893.376340233.LABEL", f"{STEMS[1]}.label")
    assert reported(found) == (
        [
            problem(
                Code.DUPLICATE_FRAME,
                "b/1623370893.376340233.LABEL",
                "one member for 1623370893-376340233",
                "a/1623370893-376340233.label, b/1623370893.376340233.LABEL",
            )
        ],
        [],
    )


def test_two_members_of_one_name_claim_one_frame(pair: Callable[..., Matched]) -> None:
    found = pair(f"{STEMS[0]}.label", f"{STEMS[0]}.label", f"{STEMS[1]}.label")
    assert [one.code for one in found.problems] == [Code.DUPLICATE_FRAME]


@pytest.mark.parametrize(
    ("name", "extension"),
    [
        ("1623370893-376340233.png", ".png"),
        ("V-02/1623370893.376340233.NPY", ".npy"),
        ("1623370893-376340233", "a name without extension"),
        ("V-02/1623370893.376340233", "a name without extension"),
    ],
)
def test_a_frame_with_another_extension_is_of_the_wrong_type_and_not_also_missing(
    pair: Callable[..., Matched], name: str, extension: str
) -> None:
    assert reported(pair(name, f"{STEMS[1]}.label")) == (
        [problem(Code.WRONG_TYPE, name, "1623370893-376340233.label", extension)],
        [],
    )


def test_an_image_track_wants_png(pair: Callable[..., Matched]) -> None:
    found = pair(f"{STEMS[0]}.PNG", f"{STEMS[1]}.label", track="2d-standard")
    assert reported(found) == (
        [problem(Code.WRONG_TYPE, f"{STEMS[1]}.label", f"{STEMS[1]}.png", ".label")],
        [],
    )


@pytest.mark.parametrize("folder", ["K-01", "sequences/K-01/predictions", "V-02/K-01", "K-01\\Labels"])
def test_a_folder_of_another_sequence_is_named(pair: Callable[..., Matched], folder: str) -> None:
    found = pair(f"{folder}/{STEMS[0]}.label", f"{STEMS[1]}.label")
    assert reported(found) == (
        [problem(Code.WRONG_SEQUENCE, f"{folder}/{STEMS[0]}.label", "V-02", "K-01")],
        [],
    )


def test_a_folder_that_is_no_sequence_says_nothing(pair: Callable[..., Matched]) -> None:
    assert reported(pair(f"V-02-run/{STEMS[0]}.label", f"V-99/{STEMS[1]}.label")) == ([], [])


def test_everything_that_is_wrong_with_names_is_reported_at_once(pair: Callable[..., Matched]) -> None:
    found = pair(f"K-01/{STEMS[0]}.label", f"V-02/{STEMS[0]}.label", f"{STEMS[0]}.png", "notes.txt")
    assert [one.code for one in (*found.problems, *found.warnings)] == [
        Code.WRONG_SEQUENCE,
        Code.WRONG_TYPE,
        Code.DUPLICATE_FRAME,
        Code.MISSING_FRAME,
        Code.UNKNOWN_MEMBER,
    ]


def test_without_frames_every_file_of_the_right_type_is_taken_for_one(wildscenes: Benchmark) -> None:
    names = ["V-02/1.5.label", "2-6.LABEL", "README.md", "__MACOSX/x.label", "a.png"]
    found = match_unknown(members(*names), wildscenes.track("3d-standard"))
    assert [(frame.name, frame.shape, member.name) for frame, member in found.pairs] == [
        ("1-5", (), "V-02/1.5.label"),
        ("2-6", (), "2-6.LABEL"),
    ]
    hint = HINTS[Code.UNKNOWN_MEMBER]
    assert reported(found) == (
        [],
        [
            {"member": "README.md", "code": "unknown_member", "hint": hint},
            {"member": "a.png", "code": "unknown_member", "hint": hint},
        ],
    )
