"""Compiled kernels (extra `fast`): PNG rows to labels, and labels to counts; each has a plain reference elsewhere.

A label map is mostly long runs of one value, so the kernels look at eight bytes at once through a *window*: an array of
uint64 whose element i is the eight bytes from byte i on. Signatures are explicit, so that nothing is compiled twice;
indices are unsigned, so that none is tested for being negative. Buffers and windows are those of `evaluator.buffer`.
"""

from evaluator.kernels.counting import HIGHEST_BIT, count_noise, count_points, count_runs
from evaluator.kernels.rows import unfilter

__all__ = ["HIGHEST_BIT", "count_noise", "count_points", "count_runs", "unfilter"]
