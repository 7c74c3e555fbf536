"""Estimation pipeline: evidence of each strike, merging of recordings, one joint estimate."""
