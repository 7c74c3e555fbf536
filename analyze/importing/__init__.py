"""Import of other cameras' images as recordings: find strikes, estimate the camera's pose, write."""
