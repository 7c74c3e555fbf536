"""Report of an answer: HTML pages, plots, JSON, CSV tables, and the summary on the terminal."""
