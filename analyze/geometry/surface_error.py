"""Error of a shape's faces along their normals: stated in the object file, or assumed."""

from __future__ import annotations

from schemas.object_spec import Shape

ASSUMED_FILE_SD = 3e-4
"""1 sigma [m] of the place of each face of a mesh without `surface_sd_m`: a file made from a drawing is good
to 0.05 to 0.1 mm, a scan to 0.3 mm or worse, and the file does not show which it is."""
ASSUMED_SIZE_SD = 1e-4
"""1 sigma [m] of the place of each face of a box or cylinder without `surface_sd_m`: its sizes were read off
a caliper or a ruler. Also the smallest that is assumed for a point cloud."""


def surface_sd(shape: Shape, noise_sd: float | None) -> float:
    """Standard deviation [m] of the place of each face along its normal, stated or else assumed.

    Args:
        shape: entry of the object file.
        noise_sd: 1 sigma [m] of a point cloud's points across its surface; None for other shapes.

    Returns:
        `surface_sd_m` where it is given, also 0; otherwise `assumed_surface_sd`.
    """
    return assumed_surface_sd(shape, noise_sd) if shape.surface_sd_m is None else shape.surface_sd_m


def assumed_surface_sd(shape: Shape, noise_sd: float | None) -> float:
    """Standard deviation [m] of the place of each face along its normal, for a shape that does not state it.

    It is `ASSUMED_SIZE_SD` for a box or cylinder given by its sizes, and `ASSUMED_FILE_SD` for a mesh. The
    points of a cloud show the quality of the scanner: its bias is assumed as large as their noise.

    Args:
        shape: entry of the object file.
        noise_sd: 1 sigma [m] of a point cloud's points across its surface; None for other shapes.
    """
    if noise_sd is not None:
        return max(noise_sd, ASSUMED_SIZE_SD)
    return ASSUMED_SIZE_SD if shape.file is None else ASSUMED_FILE_SD
