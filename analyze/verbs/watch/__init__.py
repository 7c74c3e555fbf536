"""`analyze watch`: a recording followed while it grows."""
