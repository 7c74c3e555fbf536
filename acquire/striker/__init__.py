"""Strikers: the interface, a Dynamixel-driven arm, and a person who strikes by hand."""
