"""The recording format, its MCAP core, and the documents that acquire and analyze exchange.

It imports nothing from either package.
"""
