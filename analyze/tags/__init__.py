"""Printed tags: their codes, and sheets of them to scale."""
