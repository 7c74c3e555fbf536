"""Analysis of whole archives: recordings, worker processes, stored results, queries and summaries."""
