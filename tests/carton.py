"""Object file of a small carton with one tag, for tests that need any object."""

from __future__ import annotations

CARTON = """\
name = "carton"
mass_kg = 0.044
mass_sd_kg = 0.0001
shell_thickness_m = 0.0025
edge_radius_m = 0.001

[shape]
box = { size_m = [0.08, 0.06, 0.15] }

[[marker]]
id = 3
size_m = 0.03
T_object_marker = [[0, 0, 1, 0.04], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]
"""
