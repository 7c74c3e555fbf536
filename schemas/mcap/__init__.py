"""The MCAP core of both packages: records, chunks, the walker, the summary, the content hash and the record writer."""
