"""Recordings of other cameras become ours: where images come from (source.py), which of them are a strike, how they are written."""
