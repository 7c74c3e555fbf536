"""Hidden mass distribution of a user's object: drawn from a seed, or as a truth file gives it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from acquire.errors import ConfigError
from acquire.virtual.hidden import HiddenBody, weighted_body

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.virtual.given_truth import GivenTruth
    from schemas.object_spec import ObjectSpec

MASS_TOLERANCE = 1e-6
"""relative excess of the given masses over the object's mass that counts as rounding"""
_SHELL_SHARE, _DENSITY_RATIO = (0.35, 0.6), (2.0, 6.0)
"""ranges of what is drawn: the shell's share of the mass, and the density of the upper part over the lower"""
_SHELL_M, _THINNEST = (0.001, 0.002), 0.1
"""range of the drawn thickness of the shell [m], and its largest fraction of the object's smallest extent"""
_OFF_CENTRE = 0.12
"""largest drawn distance of the dividing plane from the middle, as a fraction of the longest extent"""


def default_shell_m(spec: ObjectSpec, given: GivenTruth, smallest: float, rng: np.random.Generator) -> float:
    """Thickness of a virtual object's shell [m]: as given by truth or object file, else drawn.

    Args:
        spec: content of the object file.
        given: content of the truth file.
        smallest: smallest extent of the object [m].
        rng: generator; one number is drawn in any case.
    """
    drawn = min(float(rng.uniform(*_SHELL_M)), _THINNEST * smallest)
    return given.shell_thickness_m or spec.shell_thickness_m or drawn


def own_body(
    spec: ObjectSpec,
    given: GivenTruth,
    points: NDArray[np.float64],
    depths: NDArray[np.float64],
    shell_m: float,
    rng: np.random.Generator,
) -> HiddenBody:
    """True mass properties of a user's object: masses that the truth file gives, or drawn ones.

    Drawn are a shell with 35 to 60 % of the mass, and a plane that divides the interior into two uniform
    parts, one 2 to 6 times as dense as the other. Tags weigh what the object file states, at their places.

    Args:
        spec: content of the object file; its tags' places are complete.
        given: content of the truth file.
        points: (n, 3) points spread uniformly inside the object [m, in O, the object's frame].
        depths: (n,) depths of the points below the surface [m].
        shell_m: thickness of the shell [m].
        rng: generator of what is not given.

    Raises:
        ConfigError: the given masses or the tags' exceed the object's, or nothing of the object is where one
            of them should be.
    """
    tags = [marker for marker in spec.marker if marker.mass_kg and marker.T_object_marker]
    tag_masses = np.array([marker.mass_kg for marker in tags])
    bare_kg = spec.mass_kg - (float(tag_masses.sum()) if spec.mass_includes_markers else 0.0)
    if bare_kg <= 0:
        raise ConfigError(
            f"the tags weigh {tag_masses.sum():g} kg and the object with them {spec.mass_kg:g} kg: correct "
            "mass_kg of object and markers, or set mass_includes_markers = false"
        )
    shell = depths < shell_m
    plane = _plane(given, points, rng)
    upper = ~shell & (points @ plane[0] > plane[1])
    regions = {"shell": shell, "upper": upper, "lower": ~shell & ~upper}
    draws = rng.uniform(*_SHELL_SHARE), rng.uniform(*_DENSITY_RATIO)
    weights = (
        _given_weights(given, points, regions, bare_kg)
        if given.gives_masses
        else _drawn_weights(regions, bare_kg, *draws)
    )
    masses = tuple(float(weights[region].sum()) for region in regions.values())
    at_tags = np.array([marker.T_object_marker for marker in tags]).reshape(-1, 4, 4)[:, :3, 3]
    return weighted_body(
        np.concatenate([points, at_tags]),
        np.concatenate([weights, tag_masses]),
        (masses[0] + float(tag_masses.sum()), masses[1], masses[2]),
        plane,
        shell_m,
    )


def _plane(
    given: GivenTruth, points: NDArray[np.float64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], float]:
    """Unit normal (3,) and offset [m] of the plane that divides the interior; drawn where not given."""
    extent = np.ptp(points, axis=0)
    drawn = rng.normal(size=3) * extent  # mostly across the longest side, where it shifts the mass most
    shift = float(rng.uniform(-1, 1)) * _OFF_CENTRE * float(extent.max())
    normal = drawn if given.plane_normal is None else np.array(given.plane_normal)
    length = float(np.linalg.norm(normal))
    if length == 0:
        raise ConfigError("plane_normal of the truth file is 0: give a direction, for example [0, 0, 1]")
    normal = normal / length
    middle = float(points.mean(axis=0) @ normal)
    return normal, middle + shift if given.plane_offset_m is None else given.plane_offset_m


def _drawn_weights(
    regions: dict[str, NDArray[np.bool_]], mass_kg: float, shell_share: float, density_ratio: float
) -> NDArray[np.float64]:
    """Mass (n,) [kg] of each point, uniform within each region.

    A shell or interior without points, as in a thin object, leaves its mass to the other.

    Args:
        regions: which points belong to shell, upper and lower part.
        mass_kg: mass of all points together [kg].
        shell_share: fraction of the mass in the shell.
        density_ratio: density of the upper part over that of the lower.
    """
    interior = np.where(regions["upper"], density_ratio, 1.0) * ~regions["shell"]
    weights = shell_share * regions["shell"] / max(1, np.count_nonzero(regions["shell"]))
    weights += (1 - shell_share) * interior / max(1.0, interior.sum())
    return weights * (mass_kg / weights.sum())


def _given_weights(
    given: GivenTruth,
    points: NDArray[np.float64],
    regions: dict[str, NDArray[np.bool_]],
    mass_kg: float,
) -> NDArray[np.float64]:
    """Mass (n,) [kg] of each point by the truth file; what it leaves over is spread over the interior.

    Args:
        given: content of the truth file.
        points: (n, 3) points spread uniformly inside the object [m, in O, the object's frame].
        regions: which points belong to shell, upper and lower part.
        mass_kg: mass of all points together [kg].

    Raises:
        ConfigError: the masses exceed `mass_kg`, or no point belongs to one of them.
    """
    wanted = [
        ("shell_kg", regions["shell"], given.shell_kg or 0.0),
        ("upper_kg", regions["upper"], given.upper_kg or 0.0),
        ("lower_kg", regions["lower"], given.lower_kg or 0.0),
    ]
    for number, lump in enumerate(given.lump, 1):
        inside = np.linalg.norm(points - lump.centre_m, axis=1) < lump.radius_m
        wanted.append((f"lump {number}", inside, lump.mass_kg))
    total = sum(mass for _, _, mass in wanted)
    if total > mass_kg * (1 + MASS_TOLERANCE):
        raise ConfigError(
            f"the masses of the truth file add up to {total:g} kg, the object without its tags weighs "
            f"{mass_kg:g} kg: make them smaller; what they leave over is spread over the interior"
        )
    interior = ~regions["shell"]
    rest = interior if interior.any() else regions["shell"]
    weights = np.zeros(len(points))
    for name, region, mass in [*wanted, ("the rest", rest, max(0.0, mass_kg - total))]:
        count = np.count_nonzero(region)
        if mass > 0 and count == 0:
            raise ConfigError(
                f"the truth file puts {mass:g} kg into {name}, but nothing of the object is there: "
                "correct its centre, plane or shell_thickness_m (object's frame, metres)"
            )
        weights[region] += mass / max(1, count)
    return weights
