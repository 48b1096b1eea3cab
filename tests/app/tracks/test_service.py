"""Ground-truth releases, and what is publicly known of the one in use."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from sqlalchemy import select

from app.errors import NotFound
from app.tracks.models import GroundTruthRelease
from app.tracks.service import current_facts, frames_of, import_release, track_facts
from evaluator.build import build
from evaluator.errors import GroundTruthError
from tests.app.conftest import Demo
from tests.app.world import NOON, World


@pytest.fixture
def bare(make_world: Callable[..., World], database_url: str) -> World:
    """A service without ground truth."""
    return make_world(database_url, release=None)


def import_from(world: World, folder: Path) -> str:
    benchmark = world.wired.benchmarks["wildscenes"]
    return import_release(world.wired.db, world.wired.settings.releases, folder, benchmark, now=world.clock())


def known(world: World) -> dict[str, bool]:
    with world.wired.db.read() as session:
        return {one.digest: one.current for one in session.scalars(select(GroundTruthRelease))}


def test_before_there_is_ground_truth_nothing_is_known(bare: World) -> None:
    benchmark, track = bare.wired.tracks["2d-standard"]
    assert current_facts(bare.wired.db, benchmark) is None
    assert frames_of(None, track) == ()
    with pytest.raises(NotFound) as caught:
        track_facts(bare.wired.db, benchmark, track)
    assert caught.value.code == "no_groundtruth"


def test_an_imported_release_is_copied_and_used_from_then_on(bare: World, demo: Demo) -> None:
    digest = import_from(bare, demo.groundtruth)
    copied = bare.wired.settings.releases / digest
    assert sorted(path.name for path in copied.iterdir()) == sorted(path.name for path in demo.groundtruth.iterdir())
    facts = current_facts(bare.wired.db, bare.wired.benchmarks["wildscenes"])
    assert facts is not None
    assert (facts.groundtruth, facts.open, facts.synthetic) == (digest, False, True)
    assert known(bare) == {digest: True}


def test_importing_a_release_twice_changes_nothing(bare: World, demo: Demo) -> None:
    first = import_from(bare, demo.groundtruth)
    bare.clock.advance(60)
    assert import_from(bare, demo.groundtruth) == first
    with bare.wired.db.read() as session:
        [row] = session.scalars(select(GroundTruthRelease))
    assert (row.current, row.imported_at) == (True, NOON)


def test_the_release_imported_last_is_the_one_in_use_and_older_ones_are_kept(
    bare: World, demo: Demo, tmp_path: Path
) -> None:
    benchmark = bare.wired.benchmarks["wildscenes"]
    shutil.copytree(demo.splits, tmp_path / "splits")
    for file in (tmp_path / "splits").rglob("test.csv"):
        lines = file.read_text("utf-8").splitlines(keepends=True)
        file.write_text("".join(lines[:-1]), "utf-8")
    build(demo.data, tmp_path / "splits", tmp_path / "smaller", benchmark, allow_absent=True)
    first, second = import_from(bare, demo.groundtruth), import_from(bare, tmp_path / "smaller")
    assert known(bare) == {first: False, second: True}
    assert {path.name for path in bare.wired.settings.releases.iterdir()} == {first, second}
    import_from(bare, demo.groundtruth)
    assert known(bare) == {first: True, second: False}


def test_a_damaged_release_is_refused_and_the_one_in_use_stays(world: World, demo: Demo, tmp_path: Path) -> None:
    before = known(world)
    shutil.copytree(demo.groundtruth, tmp_path / "damaged")
    labels = tmp_path / "damaged" / "2d.runs"
    content = bytearray(labels.read_bytes())
    content[0] ^= 1
    labels.write_bytes(content)
    with pytest.raises(GroundTruthError, match="is damaged"):
        import_from(world, tmp_path / "damaged")
    assert known(world) == before


def test_the_facts_of_a_track_have_its_frames_alone(world: World) -> None:
    benchmark, track = world.wired.tracks["3d-venman-to-karawatha"]
    facts = track_facts(world.wired.db, benchmark, track)
    assert list(facts.modalities) == ["3d"]
    assert {frame.sequence for frame in facts.modalities["3d"].frames} == {"K-01", "K-03"}
    assert {frame.split for frame in facts.modalities["3d"].frames} == {"test"}
