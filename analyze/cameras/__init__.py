"""Camera calibrations: measured from board images, read from camera files, written to rig files."""
