"""A submission sent to an evaluation server over HTTP; the only part of this package that speaks it."""
