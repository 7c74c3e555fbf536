"""Recording to MCAP: frame queues with a pre-trigger time, file writer, recovery."""
