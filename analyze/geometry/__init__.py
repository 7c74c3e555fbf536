"""Shapes of objects (meshes, point clouds, primitives), their planes and distances, and rotations."""
