"""What people read cannot fall behind what the code does."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from app.main import make_app
from app.settings import Settings
from app.wiring import wire
from evaluator.errors import ARCHIVE_FAULTS, HINTS, Code, Problem

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def openapi() -> dict[str, Any]:
    wired = wire(Settings(database_url="sqlite://"))
    return make_app(wired).openapi()


def settings_in_readme() -> list[str]:
    """The settings that the table in README.md names."""
    rows = (ROOT / "README.md").read_text("utf-8").splitlines()
    found = [re.match(r"\|\s*`?(WILDSCENES_[A-Z_]+)`?\s*\|", row) for row in rows]
    return [one.group(1) for one in found if one]


def test_every_setting_stands_in_the_readme_and_nothing_else_does() -> None:
    known = {f"WILDSCENES_{name.upper()}" for name in Settings.model_fields}
    told = settings_in_readme()
    assert {"missing": sorted(known - set(told)), "unknown": sorted(set(told) - known)} == {
        "missing": [],
        "unknown": [],
    }
    assert len(told) == len(set(told))


def test_every_setting_says_what_it_is_for() -> None:
    assert [name for name, field in Settings.model_fields.items() if not field.description] == []


def test_every_route_of_the_api_is_described(openapi: dict[str, Any]) -> None:
    silent = [
        f"{method.upper()} {path}"
        for path, methods in openapi["paths"].items()
        for method, about in methods.items()
        if not about.get("description", "").strip()
    ]
    assert silent == []


def test_every_shape_of_the_api_is_described(openapi: dict[str, Any]) -> None:
    made_by_fastapi = {"HTTPValidationError", "ValidationError"}
    shapes = openapi["components"]["schemas"]
    assert [name for name, one in shapes.items() if not one.get("description")] == sorted(
        name for name in made_by_fastapi if name in shapes
    )


def test_every_problem_has_a_hint_that_ends_as_a_sentence() -> None:
    assert set(HINTS) == set(Code)
    assert [code for code, hint in HINTS.items() if not re.fullmatch(r"[A-Z`].{10,}\.", hint)] == []
    assert [code for code in Code if Problem(code).as_json()["hint"] != HINTS[code]] == []


def test_codes_of_problems_are_stable_names() -> None:
    assert [code for code in Code if code.value != code.name.lower()] == []
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
