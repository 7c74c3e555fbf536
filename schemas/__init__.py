"""The recording format, its MCAP core, and the documents that acquire and analyze exchange.

This package imports nothing from `acquire` or `analyze`.
"""
