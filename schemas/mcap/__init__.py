"""MCAP records: packing, parsing, walking, the summary section."""
