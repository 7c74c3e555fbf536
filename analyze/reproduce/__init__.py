"""Published data and results, computed again."""
