"""The compiled code of the extra `fast`, where it is installed; loaded when it is first needed, as it takes a while."""

from __future__ import annotations

import os
import tempfile
from functools import lru_cache
from importlib import import_module
from types import ModuleType

PLAIN = "WILDSCENES_PLAIN"
"""Set in the environment, it makes everything run without compiled code: the results are the same."""


@lru_cache(maxsize=1)
def kernels() -> ModuleType | None:
    """`evaluator.kernels`, or None where they cannot or shall not be used."""
    if os.environ.get(PLAIN):
        return None
    try:
        return import_module("evaluator.kernels")
    except ImportError:  # the base install
        return None
    except RuntimeError:  # numba finds no folder where it may keep what it compiled
        config = import_module("numba").config
        config.CACHE_DIR = tempfile.mkdtemp(prefix="wildscenes-kernels-")
        return import_module("evaluator.kernels")


@lru_cache(maxsize=1)
def libdeflate() -> ModuleType | None:
    """The package `deflate`, or None where it cannot or shall not be used."""
    if os.environ.get(PLAIN):
        return None
    try:
        return import_module("deflate")
    except ImportError:  # the base install
        return None
