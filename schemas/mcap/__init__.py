"""The MCAP core of both packages: reading and writing the container format of recordings.

It consists of records, chunks, the walker, the summary, the content hash and the record writer.
"""
