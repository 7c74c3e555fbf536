"""Imports other cameras' images as recordings: finds strikes, estimates the camera's pose, writes."""
