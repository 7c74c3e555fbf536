"""Recording of frames and messages to MCAP files, and recovery of files that were cut short."""
