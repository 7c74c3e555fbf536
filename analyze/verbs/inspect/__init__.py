"""`analyze inspect`: contents and health of a recording."""
