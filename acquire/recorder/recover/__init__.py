"""Rebuilding recordings that were cut short, and editing whole ones."""
