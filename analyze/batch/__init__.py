"""Analysis of archives of recordings in worker processes; stored results, queries and summaries."""
