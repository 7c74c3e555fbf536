"""Checks before a session: everything that can be wrong, each line pass or fail with the measured number and the remedy."""
