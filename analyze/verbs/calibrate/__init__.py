"""`analyze calibrate`: a camera's lens and pose from images of a board."""
