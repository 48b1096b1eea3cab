"""Score predicted label maps of the WildScenes benchmark: archives, labels, ground truth, counts and metrics."""

from importlib.metadata import version

__version__ = version("wildscenes")

SCORING_VERSION = 1
"""Raised only when a figure can change for the same files; kept beside every result."""
