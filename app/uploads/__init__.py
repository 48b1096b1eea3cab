"""Receiving bytes."""
