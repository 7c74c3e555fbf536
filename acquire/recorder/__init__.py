"""Recording to MCAP files: frame queues with a pre-trigger time, file writer, recovery of cut files."""
