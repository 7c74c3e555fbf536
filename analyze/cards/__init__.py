"""Placement cards: instructions and pictures of a plan for the person at the table."""
