"""Recordings in half the bytes: images as PNG without loss, or as JPEG within the camera's noise."""
