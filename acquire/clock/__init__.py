"""Clocks: the host's, and the mapping of a device's clock to it."""
