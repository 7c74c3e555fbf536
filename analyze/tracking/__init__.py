"""Poses of square markers, found in images and followed through the frames of a strike."""
