"""Reading recordings: finished, cut short, still growing, or written by other programs."""
