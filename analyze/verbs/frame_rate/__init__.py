"""`analyze frame-rate`: the true frame rate of a camera, from a video of a falling tag."""
