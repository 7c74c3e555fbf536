"""Makes tags and calibration boards to be printed: their bit patterns, and true-to-scale sheets."""
