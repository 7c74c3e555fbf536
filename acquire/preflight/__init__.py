"""Checks of a rig before a session; each reports pass or fail, the measured value and the remedy."""
