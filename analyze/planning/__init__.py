"""Which strikes to make: stable planes, pivots, impact points, the best set."""
