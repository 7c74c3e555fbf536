"""Mean and covariance of all straight lines, device time to host time, that clock readings permit.

A clock reading is a device time between two readings of the host clock: a line must pass between them. A line
has an offset and a rate; the lines that satisfy all readings are a convex polygon in the plane of the two.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from acquire.clock.reading import ClockReading

Point = tuple[float, float]
DRIFT_UNIT_NS = 1e9
"""unit of time of the drift inside the polygon [ns]: offset and drift then have similar size"""
_THIN_AREA = 1e-9
"""area, as a fraction of the extent squared, below which a polygon counts as a line: triangles would divide
by zero"""


@dataclass(frozen=True)
class LineBounds:
    """Mean and covariance of all lines from device to host clock that satisfy the clock readings.

    A line is (host - host0) - (device - device0) = offset + rate * (device - device0), for a device time
    `device` and a host time `host` [ns]. device0 is the device time of the newest reading, host0 the host
    time just before that reading (`host_before_ns`). Mean and covariance are those of (offset [ns], rate).
    """

    offset_ns: float
    """mean offset [ns]"""
    rate: float
    """mean rate of the host clock against the device clock, minus 1; a pure number"""
    covariance: tuple[float, float, float]
    """covariance of (offset, rate): var(offset) [ns^2], cov [ns], var(rate)"""


def lines_between(readings: Sequence[ClockReading], rate_limit: float) -> LineBounds | None:
    """Mean and covariance of the uniform distribution over all lines that satisfy every clock reading.

    Args:
        readings: at least one clock reading, oldest first: a device time between two host times.
        rate_limit: greatest |rate| of a line. The rate is the host clock's against the device clock's,
            minus 1.

    Returns:
        Mean and covariance of the lines' offset [ns] and rate (a pure number); None if no line satisfies all
        readings. The offset is a line's host time at the newest reading, minus that reading's
        `host_before_ns`.
    """
    newest = readings[-1]
    width = float(max(1, newest.host_after_ns - newest.host_before_ns))
    steepest = rate_limit * DRIFT_UNIT_NS
    polygon: list[Point] = [(0.0, -steepest), (width, -steepest), (width, steepest), (0.0, steepest)]
    # The tightest bounds first: most of the others then cut off nothing.
    for reading in sorted(readings, key=lambda reading: reading.host_after_ns - reading.host_before_ns):
        elapsed = reading.device_time_ns - newest.device_time_ns
        u = elapsed / DRIFT_UNIT_NS
        lower = float(reading.host_before_ns - newest.host_before_ns - elapsed)
        upper = lower + max(1, reading.host_after_ns - reading.host_before_ns)
        polygon = _clip(_clip(polygon, 1.0, u, -lower), -1.0, -u, upper)
        if not polygon:
            return None
    (offset, slope), (var_offset, cov, var_slope) = _moments(polygon)
    return LineBounds(
        offset, slope / DRIFT_UNIT_NS, (var_offset, cov / DRIFT_UNIT_NS, var_slope / DRIFT_UNIT_NS**2)
    )


def _clip(polygon: list[Point], a: float, b: float, c: float) -> list[Point]:
    """Cut off the part of a convex polygon where a x + b y + c < 0.

    The polygon is given by its corners (x, y) in order. Method of Sutherland and Hodgman (1974).

    Returns:
        Corners (x, y) of the part that remains, in order; an empty list if none remains.
    """
    distance = [a * x + b * y + c for x, y in polygon]
    if min(distance, default=0.0) >= 0.0:
        return polygon
    kept: list[Point] = []
    for i, (x, y) in enumerate(polygon):
        d, before = distance[i], distance[i - 1]
        if (d >= 0.0) != (before >= 0.0):
            x0, y0 = polygon[i - 1]
            t = before / (before - d)
            kept.append((x0 + t * (x - x0), y0 + t * (y - y0)))
        if d >= 0.0:
            kept.append((x, y))
    return kept


def _moments(polygon: list[Point]) -> tuple[Point, tuple[float, float, float]]:
    """Mean and covariance of the uniform distribution over a convex polygon with at least one corner.

    The polygon is summed as a fan of triangles. A polygon without area counts as the line between its ends.

    Args:
        polygon: corners (x, y), in order.

    Returns:
        Mean (x, y), and covariance (var x, cov, var y).
    """
    x0, y0 = polygon[0]
    area = sx = sy = sxx = sxy = syy = 0.0
    for (x1, y1), (x2, y2) in pairwise(polygon[1:]):
        ax, ay, bx, by = x1 - x0, y1 - y0, x2 - x0, y2 - y0
        twice = ax * by - ay * bx
        # Over a triangle with one corner at the origin: the mean is the corners' sum / 3, the mean of a
        # product their sums' / 12.
        cx, cy = ax + bx, ay + by
        area += twice
        sx += twice * cx / 3.0
        sy += twice * cy / 3.0
        sxx += twice * (ax * ax + bx * bx + cx * cx) / 12.0
        sxy += twice * (ax * ay + bx * by + cx * cy) / 12.0
        syy += twice * (ay * ay + by * by + cy * cy) / 12.0
    extent = max(((x - x0) ** 2 + (y - y0) ** 2 for x, y in polygon), default=0.0)
    if abs(area) <= _THIN_AREA * extent or area == 0.0:
        return _line_moments(polygon)
    mx, my = sx / area, sy / area
    return (x0 + mx, y0 + my), (sxx / area - mx * mx, sxy / area - mx * my, syy / area - my * my)


def _line_moments(polygon: list[Point]) -> tuple[Point, tuple[float, float, float]]:
    """Mean (x, y) and covariance (var x, cov, var y) of points spread evenly along a polygon without area.

    The polygon's two ends are its least and its greatest corner, compared by x, then by y.
    """
    (ax, ay), (bx, by) = min(polygon), max(polygon)
    dx, dy = bx - ax, by - ay
    return ((ax + bx) / 2.0, (ay + by) / 2.0), (dx * dx / 12.0, dx * dy / 12.0, dy * dy / 12.0)
