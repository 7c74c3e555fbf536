"""Placement cards: what the person at the table sees of a plan."""
