"""`analyze calibrate`: a camera from images of a board, or its frame rate from a video of a falling tag."""
