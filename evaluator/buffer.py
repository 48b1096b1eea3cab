"""Memory for one frame's labels that is used again for the next: a fresh allocation costs as much as counting."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

PADDING = 64
"""Bytes behind what a buffer holds that kernels may read or write, whatever stands there."""


def window(memory: NDArray[np.uint8]) -> NDArray[np.uint64]:
    """The eight bytes from each byte on, as numbers: shape (N - 7,) for shape (N,), sharing its memory."""
    made: NDArray[np.uint64] = np.ndarray((memory.size - 7,), np.uint64, memory, 0, (1,))
    return made


class Buffer:
    """Labels of one frame at a time; not to be shared between threads.

    Attributes:
        memory: the bytes, `PADDING` of them behind what was taken.
        window: their window.
    """

    def __init__(self) -> None:
        """Hold nothing yet."""
        self._grow(0)

    def take(self, size: int) -> NDArray[np.uint8]:
        """Room for so many labels, shape (size,); what was taken before is given up."""
        if self.memory.size < size + PADDING:
            self._grow(size)
        return self.memory[:size]

    def _grow(self, size: int) -> None:
        self.memory = np.zeros(size + PADDING, np.uint8)
        self.window = window(self.memory)
