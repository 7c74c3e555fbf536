"""Strikes left out of the estimate, simulated with the exported body and compared with the video."""
