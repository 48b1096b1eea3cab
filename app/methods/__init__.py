"""The methods that submissions belong to."""
