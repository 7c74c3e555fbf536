"""Host clock, and the mapping of a device's clock to it."""
