"""The experiments of the paper (VISAPP 2013, section 4) made again: its tables and figures beside ours, on recordings of known truth."""
