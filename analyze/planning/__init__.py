"""Planning of strikes: stable planes, pivot axes, impact points, and the most informative set."""
