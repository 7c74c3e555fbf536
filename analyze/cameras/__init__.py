"""Camera calibrations: measured from board images, read from other programs' files, written to rig files."""
