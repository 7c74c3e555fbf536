"""Prints tags and calibration boards: their codes, and true-to-scale sheets."""
