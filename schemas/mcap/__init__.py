"""The MCAP core of both packages.

Records, chunks, the walker, the summary, the content hash and the record writer.
"""
