"""Shapes and rotations."""
