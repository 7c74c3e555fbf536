"""Printable parts of a rig: arm, pad, horn adapters, bearing hub, camera holder, mat clamp."""
