"""Tracks and the ground-truth releases that they are scored against."""
