"""Checks of a rig before a session; each reports its outcome, the finding and the remedy."""
