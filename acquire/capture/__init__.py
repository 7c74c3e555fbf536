"""The capture process: a child of the daemon that reads the camera and writes the recording."""
