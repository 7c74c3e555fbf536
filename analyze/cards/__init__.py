"""Placement cards: one page for each planned strike, with instructions and pictures."""
