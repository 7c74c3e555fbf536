"""Export of shape and inertial parameters for simulators as URDF, SDF, MJCF or USD, with a check."""
