"""Terminal interface of sessions and single strikes."""
