"""Poses of an object's glued-on markers, estimated from strikes that tip it over known edges."""
