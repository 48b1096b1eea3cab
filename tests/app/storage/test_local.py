"""Objects as files in a folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.storage.local import LocalStorage


@pytest.fixture
def storage(tmp_path: Path) -> LocalStorage:
    return LocalStorage(tmp_path)


def content(storage: LocalStorage, key: str) -> bytes:
    with storage.local(key) as path:
        return path.read_bytes()


def test_an_object_does_not_exist_for_others_before_it_is_committed(storage: LocalStorage, tmp_path: Path) -> None:
    writer = storage.create("a.zip")
    writer.write(b"one ")
    writer.write(b"two")
    with pytest.raises(FileNotFoundError), storage.local("a.zip"):
        pass
    writer.commit()
    assert content(storage, "a.zip") == b"one two"
    assert [path.name for path in tmp_path.iterdir()] == ["a.zip"]


def test_an_aborted_object_leaves_nothing(storage: LocalStorage, tmp_path: Path) -> None:
    writer = storage.create("a.zip")
    writer.write(b"half")
    writer.abort()
    assert list(tmp_path.iterdir()) == []


def test_an_abort_after_the_commit_harms_nothing(storage: LocalStorage) -> None:
    writer = storage.create("a.zip")
    writer.write(b"whole")
    writer.commit()
    writer.abort()
    assert content(storage, "a.zip") == b"whole"


def test_an_object_is_replaced_on_commit_and_not_before(storage: LocalStorage) -> None:
    for data in (b"old", b"new"):
        writer = storage.create("a.zip")
        writer.write(data)
        if data == b"new":
            assert content(storage, "a.zip") == b"old"
        writer.commit()
    assert content(storage, "a.zip") == b"new"


def test_two_writers_of_one_key_do_not_mix(storage: LocalStorage) -> None:
    first, second = storage.create("a.zip"), storage.create("a.zip")
    first.write(b"first")
    second.write(b"second")
    second.commit()
    first.abort()
    assert content(storage, "a.zip") == b"second"


def test_deleting_is_harmless_when_there_is_nothing(storage: LocalStorage) -> None:
    storage.create("a.zip").commit()
    storage.delete("a.zip")
    storage.delete("a.zip")
    with pytest.raises(FileNotFoundError), storage.local("a.zip"):
        pass
