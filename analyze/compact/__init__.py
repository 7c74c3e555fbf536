"""Recordings in half the bytes: images as PNG, without loss, or exact only where they show structure."""
