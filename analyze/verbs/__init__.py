"""Verbs of the command `analyze`, a file or folder each: options, work and printed tables.

A verb is a subcommand, such as `estimate` in `analyze estimate`. A new one is registered in analyze/cli.py.
"""
