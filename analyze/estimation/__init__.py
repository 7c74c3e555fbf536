"""From phi and k to centre of mass, inertia and region masses."""
