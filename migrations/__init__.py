"""The database's history: one file a step, forward only in production."""
