"""A body written for simulators: shape, mass, centre of mass and inertia as URDF, SDF, MJCF or USD, each loaded back before it is left."""
