"""Report of an estimate: HTML pages, plots, JSON, CSV tables, and the summary on the terminal."""
