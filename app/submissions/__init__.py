"""The life cycle of a submission, from its upload to its scores."""
