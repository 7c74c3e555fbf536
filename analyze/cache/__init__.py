"""Results of long computations kept on disk, so that the next command need not compute them again."""
