"""Camera calibration from views of a board: the lens, its uncertainty, and the camera's pose."""
