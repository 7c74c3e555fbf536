"""Camera calibrations: measured from images of a board, read from files of other programs, written into rig files."""
