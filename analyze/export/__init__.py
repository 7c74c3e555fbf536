"""Bodies for simulators: shape and inertial parameters as URDF, SDF, MJCF or USD, each file read back."""
