"""The bytes of one upload on their way to storage."""

from __future__ import annotations

import asyncio
import hashlib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.errors import TooLarge
from app.storage.local import LocalStorage
from app.uploads.receiving import BLOCK, Received, Receiver


async def receive(folder: Path, blocks: list[bytes], *, max_bytes: int) -> Received:
    receiver = Receiver(LocalStorage(folder), "a.zip", max_bytes=max_bytes)
    await receiver.begin()
    try:
        for block in blocks:
            await receiver.take(block)
        return await receiver.finish()
    except BaseException:
        receiver.abort()
        raise


@settings(deadline=None, max_examples=20)
@given(st.lists(st.integers(0, BLOCK + 7), max_size=6))
def test_what_arrives_is_stored_hashed_and_counted_whatever_its_blocks(
    tmp_path_factory: pytest.TempPathFactory, sizes: list[int]
) -> None:
    folder = tmp_path_factory.mktemp("uploads")
    blocks = [bytes([n]) * size for n, size in enumerate(sizes)]
    whole = b"".join(blocks)
    got = asyncio.run(receive(folder, blocks, max_bytes=len(whole)))
    assert got == Received("a.zip", hashlib.sha256(whole).hexdigest(), len(whole))
    assert (folder / "a.zip").read_bytes() == whole


def test_one_byte_more_than_an_upload_may_have_leaves_nothing_behind(tmp_path: Path) -> None:
    with pytest.raises(TooLarge) as caught:
        asyncio.run(receive(tmp_path / "uploads", [b"x" * BLOCK, b"xx"], max_bytes=BLOCK + 1))
    assert caught.value.detail == f"an upload has at most {BLOCK + 1} bytes"
    assert list((tmp_path / "uploads").iterdir()) == []
