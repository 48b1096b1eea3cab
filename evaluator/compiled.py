"""The compiled code of the extra `fast`, where it is installed; the kernels only when there is work enough for them."""

from __future__ import annotations

import os
import tempfile
from functools import lru_cache
from importlib import import_module
from types import ModuleType

PLAIN = "WILDSCENES_PLAIN"
"""Set in the environment, it makes everything run without compiled code: the results are the same."""

WORTH_LOADING = 150_000_000
"""Pixels or points from which on a process is sooner done with kernels: loading them takes about a second."""

_loaded: list[ModuleType | None] = []


def kernels() -> ModuleType | None:
    """`evaluator.kernels` once `load` has loaded them; until then None, and everything runs plainly."""
    return _loaded[0] if _loaded else None


def load(pixels: int = WORTH_LOADING) -> None:
    """Load the kernels, where they are installed and so many pixels or points are worth it."""
    if _loaded or pixels < WORTH_LOADING:
        return
    _loaded.append(None if os.environ.get(PLAIN) else _import_kernels())


def forget() -> None:
    """Look again at what is installed and wanted; for tests."""
    _loaded.clear()
    libdeflate.cache_clear()


@lru_cache(maxsize=1)
def libdeflate() -> ModuleType | None:
    """The package `deflate`, or None where it cannot or shall not be used."""
    if os.environ.get(PLAIN):
        return None
    try:
        return import_module("deflate")
    except ImportError:  # the base install
        return None


def _import_kernels() -> ModuleType | None:
    try:
        return import_module("evaluator.kernels")
    except ImportError:  # the base install
        return None
    except RuntimeError:  # numba finds no folder where it may keep what it compiled
        config = import_module("numba").config
        config.CACHE_DIR = tempfile.mkdtemp(prefix="wildscenes-kernels-")
        return import_module("evaluator.kernels")
