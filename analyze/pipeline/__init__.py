"""From recordings to numbers: evidence of each strike, merged recordings, one estimate."""
