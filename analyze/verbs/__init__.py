"""The verbs of `analyze`, a file or folder each: options, work, and the tables that are printed.

A new verb is registered in analyze/cli.py.
"""
