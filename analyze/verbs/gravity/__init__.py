"""`analyze gravity`: tilt of the table from images of a plumb line."""
