"""`analyze archive`: catalogue of an archive's recordings."""
