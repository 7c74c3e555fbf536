"""Strikers."""
