"""Bounded queue to MCAP: writer, pre-trigger ring, recovery."""
