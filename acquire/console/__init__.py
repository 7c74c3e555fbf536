"""The terminal side of sessions and single strikes."""
