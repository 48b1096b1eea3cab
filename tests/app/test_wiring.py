"""The parts of a running service, put together."""

from __future__ import annotations

from datetime import UTC
from importlib import resources
from pathlib import Path

import pytest
from pydantic import ValidationError
from sqlalchemy import text
from starlette.testclient import TestClient

from app.settings import Settings
from app.wiring import utc_now, wire
from evaluator.errors import BenchmarkError
from tests.app.world import World

OURS = Path(str(resources.files("evaluator") / "benchmarks" / "wildscenes.toml"))


def settings(home: Path, **chosen: object) -> Settings:
    return Settings.model_validate({"home": home, "database_url": "sqlite://", "broker_url": "redis://b", **chosen})


def test_without_settings_everything_is_in_the_home_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DATABASE_URL", "GROUNDTRUTH"):
        monkeypatch.delenv(f"WILDSCENES_{name}", raising=False)
    made = Settings(home=tmp_path)
    assert (made.database, made.releases, made.uploads) == (
        f"sqlite:///{tmp_path}/wildscenes.sqlite",
        tmp_path / "groundtruth",
        tmp_path / "uploads",
    )


def test_a_setting_comes_from_its_environment_variable(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("WILDSCENES_BENCHMARKS", f'["{OURS}"]')
    monkeypatch.setenv("WILDSCENES_GROUNDTRUTH", str(tmp_path))
    monkeypatch.setenv("WILDSCENES_LEASE_SECONDS", "6")
    made = Settings()
    assert (made.benchmarks, made.releases, made.lease_seconds) == ([OURS], tmp_path, 6)


@pytest.mark.parametrize("name", [name for name in Settings.model_fields if name.endswith(("_seconds", "_threads"))])
def test_times_and_numbers_of_threads_are_above_zero(name: str) -> None:
    with pytest.raises(ValidationError):
        Settings.model_validate({name: 0})


def test_a_server_has_wildscenes_unless_it_is_told_otherwise(tmp_path: Path) -> None:
    made = wire(settings(tmp_path))
    assert list(made.benchmarks) == ["wildscenes"]
    assert {track: (benchmark.id, one.id) for track, (benchmark, one) in made.tracks.items()} == {
        track: ("wildscenes", track) for track in made.benchmarks["wildscenes"].all_tracks
    }


def test_two_benchmarks_live_side_by_side_when_their_ids_and_tracks_differ(tmp_path: Path) -> None:
    other = OURS.read_text("utf-8").replace('id = "wildscenes"', 'id = "second"', 1)
    for prefix in ("2d-", "3d-"):
        other = other.replace(f'id = "{prefix}', f'id = "second-{prefix}').replace(
            f'track = "{prefix}', f'track = "second-{prefix}'
        )
        other = other.replace(f'"{prefix}standard"]', f'"second-{prefix}standard"]')
    path = tmp_path / "second.toml"
    path.write_text(other, "utf-8")
    made = wire(settings(tmp_path, benchmarks=[OURS, path]))
    assert list(made.benchmarks) == ["wildscenes", "second"]
    assert len(made.tracks) == 24


def test_two_benchmarks_of_one_id_stop_the_server_with_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(BenchmarkError, match="^ids are used twice: 2d-karawatha-to-karawatha, .*, wildscenes$"):
        wire(settings(tmp_path, benchmarks=[OURS, OURS]))


def test_the_time_is_aware() -> None:
    assert utc_now().tzinfo is UTC


def test_the_log_of_a_fault_holds_its_traceback_but_no_values_of_variables(
    small_world: World, client: TestClient, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whatever packages for pretty tracebacks happen to be installed: the values may be tokens."""
    token = small_world.token()
    with small_world.wired.db.begin() as session:
        session.execute(text("DROP TABLE groundtruth_releases"))
    assert client.get("/api/v1/tracks", headers={"Authorization": f"Bearer {token}"}).status_code == 500
    said = "".join(capsys.readouterr())
    assert "Traceback (most recent call last)" in said
    assert "no such table: groundtruth_releases" in said
    assert token not in said
    assert " locals " not in said
