"""Boards: who stands where."""
