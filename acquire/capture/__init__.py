"""The capture process: reads the camera and writes the recording, nothing else."""
