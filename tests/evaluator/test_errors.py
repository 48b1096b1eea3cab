"""Every code has a hint, and a problem reads the same wherever it is printed."""

from __future__ import annotations

import pytest

from evaluator.errors import ARCHIVE_FAULTS, HINTS, Code, Problem, Refused, WildScenesError


def test_a_hint_and_a_meaning_exist_for_every_code() -> None:
    assert set(HINTS) == set(Code)
    assert all(hint.endswith(".") for hint in HINTS.values())


def test_the_faults_of_an_archive_are_the_eight_that_stop_at_once() -> None:
    assert {code.value for code in ARCHIVE_FAULTS} == {
        "not_a_zip",
        "damaged_archive",
        "too_many_members",
        "overlapping_members",
        "unsafe_name",
        "special_file",
        "encrypted_member",
        "unsupported_compression",
    }


@pytest.mark.parametrize(
    ("one", "line"),
    [
        (Problem(Code.ENCRYPTED_MEMBER, "a.png"), "a.png: encrypted_member. Make the archive without a password."),
        (
            Problem(Code.WRONG_SIZE, "a.png", "3x2", "2x2", "Resize."),
            "a.png: wrong_size (expected 3x2, found 2x2). Resize.",
        ),
        (
            Problem(Code.TOO_MANY_MEMBERS, None, None, "61"),
            "too_many_members (found 61). Send the frames of one track only.",
        ),
    ],
)
def test_a_problem_fits_on_a_line_of_a_terminal(one: Problem, line: str) -> None:
    assert str(one) == line


def test_a_problem_as_json_has_a_hint_of_its_own_or_that_of_its_code() -> None:
    assert Problem(Code.WRONG_SIZE, "a.png", "3x2", "2x2", "Resize.").as_json() == {
        "member": "a.png",
        "code": "wrong_size",
        "expected": "3x2",
        "found": "2x2",
        "hint": "Resize.",
    }
    assert Problem(Code.NOT_A_ZIP).as_json() == {
        "member": None,
        "code": "not_a_zip",
        "expected": None,
        "found": None,
        "hint": HINTS[Code.NOT_A_ZIP],
    }


@pytest.mark.parametrize("one", [Problem(Code.NOT_A_ZIP), Problem(Code.WRONG_SIZE, "a.png", "3x2", "2x2", "Resize.")])
def test_a_problem_that_was_kept_comes_back_as_it_was(one: Problem) -> None:
    assert Problem.from_row(one.as_row()) == one


def test_a_warning_is_shorter() -> None:
    assert Problem(Code.UNKNOWN_MEMBER, "README", "nothing", "something").as_warning() == {
        "member": "README",
        "code": "unknown_member",
        "hint": HINTS[Code.UNKNOWN_MEMBER],
    }


def test_a_refusal_carries_its_problem_and_says_it() -> None:
    refusal = Refused(Problem(Code.ENCRYPTED_MEMBER, "a.png"))
    assert isinstance(refusal, WildScenesError)
    assert str(refusal) == str(refusal.problem)
