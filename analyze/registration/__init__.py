"""Poses of an object's glued-on markers, found from how it rested and over which edges it tipped."""
