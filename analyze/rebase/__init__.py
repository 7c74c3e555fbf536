"""Recordings with another object file: its changes, whether the plan still holds, and the rewritten files."""
