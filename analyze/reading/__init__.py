"""Recordings as they lie on disk: ours, cut short, still growing, written by others."""
