"""The command `analyze rebase`."""
