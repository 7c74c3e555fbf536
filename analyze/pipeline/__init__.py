"""Estimation pipeline: fitted motion of each strike (evidence), merged recordings, one joint estimate."""
