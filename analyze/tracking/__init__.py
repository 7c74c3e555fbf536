"""From pixels to poses."""
