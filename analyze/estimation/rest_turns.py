"""Turn of the object at rest about the pivot edge before each strike, as its markers show it.

A crumb under the object turns its pose at rest, and so does an error of a scanned face's slopes; the balance
angle phi is measured from there. A marker shows the turn against the planned pose, with the errors of its
pose on the object and of the camera's pose, which strikes share. The sd of the turns from strike to strike is
a variance component, estimated from what is seen.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from analyze.estimation.scatter import factor_log_prior
from analyze.least_squares.intervals import normal_sd
from analyze.types import Array, RestTurn

USUAL_SD = 2e-4
"""Usual 1 sigma [rad] of the turn at rest, before any marker is looked at; a clean table."""
PRIOR_FREEDOM, PRIOR_SCALE = 0.5, 0.1
"""Degrees of freedom and scale of the prior of the factor on `USUAL_SD`: few, so that it takes little from
turns that the markers show."""
FACTORS = np.geomspace(0.2, 300.0, 50)
"""Factors on `USUAL_SD` whose likelihood is evaluated."""
CAMERA_SD = 0.02
"""1 sigma [rad] of the camera's roll against the table: only differences between strikes count."""
UNMEASURED_SD = 0.1
"""1 sigma [rad] of the pose on the object of a marker that was moved."""
UNKNOWN_SLOPE_SD = 0.05
"""1 sigma [rad] of a face's slopes against those of the scan, where the object rests on other points of it
than the scan's hull."""
LOG_ODDS_MOVED, LOG_ODDS_SLOPE = float(np.log(100.0)), float(np.log(30.0))
"""Logarithms of the odds before any strike that a marker still is where it was measured, and that the slopes
of a scanned face err no more than the scan says: of 405 axes of scanned objects, 11 lay on faces that did."""
LOG_ODDS_ALIKE = float(np.log(20.0))
"""Logarithm of the odds up to which a second explanation of the same turns counts as well."""


@dataclass(frozen=True)
class RestTurns:
    """Turns [rad] of the object at rest about the pivot axes, towards the tip, of n strikes."""

    mean: Array
    """(n,) expected turn [rad]; 0 where no marker shows it."""
    root: Array
    """(n, n) root L of the turns' covariance L L^T [rad]."""
    sd: float
    """1 sigma of the turns from strike to strike [rad], as the markers show it."""
    moved: tuple[str, ...]
    """Names of markers that contradict their stated poses on the object, which are not used."""
    lying_askew: tuple[str, ...] = ()
    """Names of resting faces on which the object lies turned by more than the errors of the scan's slopes."""
    either: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...] = ()
    """Names of faces, and of markers, of which either may be at fault; both count as unknown."""


def rest_turns(
    seen: Sequence[Sequence[RestTurn]],
    by_faces: Array | None = None,
    doubtful: Mapping[str, Array] | None = None,
) -> RestTurns | None:
    """Turns of the object at rest, from what its markers show before each strike.

    They are normal with an sd that is estimated too, by the likelihood of what is seen; the errors that
    strikes share are integrated out. Turns that are too large for them show a marker that was moved, or a
    face on which the object does not lie as the scan says. Where either explains them, both count as unknown.

    Args:
        seen: what each strike's markers show, one entry per strike; empty where none has a known place.
        by_faces: (n, n) covariance [rad^2] of the turns by the slopes of the resting faces; None for 0.
        doubtful: (n, n) further covariance [rad^2] of the turns if a face's slopes are unknown, by its name.

    Returns:
        Expected turns [rad] with their covariance, the sd of the turns from strike to strike, and the names
        of markers that were moved on the object and are not used, and of faces on which it lies askew; None
        if no marker with a known place is seen and no slope errs.
    """
    each = [turn for turns in seen for turn in turns]
    slopes = np.zeros((len(seen), len(seen))) if by_faces is None else by_faces
    if not each:
        return RestTurns(np.zeros(len(seen)), _root(slopes), 0.0, ()) if np.any(slopes) else None
    strike = np.array([i for i, turns in enumerate(seen) for _ in turns])
    to_strike = (strike[:, None] == np.arange(len(seen))).astype(np.float64)
    doubt = _Doubt(each, to_strike, slopes, doubtful or {})
    unknown, density, either = doubt.unknown()
    slopes = doubt.slopes(unknown)
    moved, askew = _names(unknown, _MARKER), _names(unknown, _FACE)
    errors = _errors(each, frozenset(moved))
    probability = np.exp(density - density.max())
    sd = USUAL_SD * normal_sd(FACTORS, probability / probability.sum())
    if not np.any(slopes):
        seen_turns = errors + sd**2 * (to_strike @ to_strike.T)
        gain = np.asarray(sd**2 * np.linalg.solve(seen_turns, to_strike), dtype=np.float64).T
        covariance = sd**2 * (np.eye(len(seen)) - gain @ to_strike)
        root = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
        return RestTurns(gain @ _angles(each), root, sd, moved, askew, either)
    prior = sd**2 * np.eye(len(seen)) + slopes
    seen_turns = errors + to_strike @ prior @ to_strike.T
    gain = np.asarray(np.linalg.solve(seen_turns, to_strike @ prior), dtype=np.float64).T
    root = _root(prior - gain @ to_strike @ prior)
    return RestTurns(gain @ _angles(each), root, sd, moved, askew, either)


_MARKER, _FACE = "marker", "face"
_Suspect = tuple[str, str]
"""Kind (marker or face) and name of what may err by more than stated."""
_Either = tuple[tuple[str, ...], tuple[str, ...]]
"""Names of faces, and of markers, of which either explains the same turns."""


@dataclass(frozen=True)
class _Doubt:
    """Choice of the markers and faces that err by more than stated."""

    each: Sequence[RestTurn]
    """Turns as markers show them."""
    to_strike: Array
    """(turns, strikes) 1 where a turn is that of a strike, else 0."""
    by_faces: Array
    """(strikes, strikes) covariance of the turns by the faces' slopes [rad^2]."""
    doubtful: Mapping[str, Array]
    """(strikes, strikes) covariance of the turns [rad^2] if the slopes of a face are unknown, by its name."""

    def unknown(self) -> tuple[frozenset[_Suspect], Array, tuple[_Either, ...]]:
        """Markers and faces whose stated errors the turns contradict, and the log density of the turns then.

        Third, the faces and the markers of which either explains the same turns, as `RestTurns.either`.
        """
        suspects = {(_MARKER, turn.marker) for turn in self.each} | {(_FACE, name) for name in self.doubtful}
        unknown: frozenset[_Suspect] = frozenset()
        density = self.density(unknown)
        either: list[_Either] = []
        while more := sorted(suspects - unknown):
            tried = {each: self.density(unknown | {each}) for each in more}
            score = {each: _total(tried[each]) - _log_odds(each) for each in more}
            best = max(more, key=lambda each: score[each])
            if score[best] < _total(density):
                break
            alike = {each for each in more if score[each] > score[best] - LOG_ODDS_ALIKE}
            alike = {each for each in alike if each[0] != best[0]} | {best}
            if len(alike) > 1:
                either.append((_names(alike, _FACE), _names(alike, _MARKER)))
            unknown |= alike
            density = self.density(unknown)
        return unknown, density, tuple(either)

    def density(self, unknown: frozenset[_Suspect]) -> Array:
        """Log density of the turns if some markers' poses and faces' slopes are unknown."""
        errors = _errors(self.each, frozenset(_names(unknown, _MARKER)))
        shown = self.to_strike @ self.slopes(unknown) @ self.to_strike.T
        return _log_density(errors + shown, self.to_strike, _angles(self.each))

    def slopes(self, unknown: frozenset[_Suspect]) -> Array:
        """Covariance (strikes, strikes) [rad^2] of the turns by the slopes, those of some faces unknown."""
        total = self.by_faces
        for kind, name in unknown:
            if kind == _FACE:
                total = total + self.doubtful[name]
        return total


def _names(suspects: Iterable[_Suspect], kind: str) -> tuple[str, ...]:
    return tuple(sorted(name for each, name in suspects if each == kind))


def _log_odds(suspect: _Suspect) -> float:
    return LOG_ODDS_MOVED if suspect[0] == _MARKER else LOG_ODDS_SLOPE


def _angles(each: Sequence[RestTurn]) -> Array:
    """Turns (n,) [rad] that n markers show."""
    return np.array([turn.angle for turn in each])


def _root(covariance: Array) -> Array:
    """Root (n, n) L of a covariance L L^T (n, n), which may be singular."""
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)), dtype=np.float64)


def _errors(each: Sequence[RestTurn], unmeasured: frozenset[str]) -> Array:
    """Covariance (n, n) [rad^2] of the errors of n turns, with some markers' poses taken as unmeasured.

    Args:
        each: turns as markers show them.
        unmeasured: names of these markers.
    """
    by_marker = np.array([UNMEASURED_SD if turn.marker in unmeasured else turn.marker_sd for turn in each])
    errors = np.diag([turn.sd**2 for turn in each])
    errors += _alike([turn.marker for turn in each]) * np.outer(by_marker, by_marker)
    return errors + _alike([turn.camera for turn in each]) * CAMERA_SD**2


def _alike(names: Sequence[str]) -> Array:
    """Matrix (n, n) with 1 where two of n names are the same, else 0."""
    each = np.array(names)
    return (each[:, None] == each).astype(np.float64)


def _log_density(errors: Array, to_strike: Array, angle: Array) -> Array:
    """Log density (k,), up to a constant, of the turns seen and of each of k factors on their usual sd.

    The factors are `FACTORS`, the usual sd is `USUAL_SD`; the prior of the factor is included.

    Args:
        errors: (n, n) covariance of the errors of n turns [rad^2].
        to_strike: (n, strikes) 1 where a turn is that of a strike, else 0.
        angle: (n,) turns as markers show them [rad].
    """
    by_turn = (USUAL_SD * FACTORS[:, None, None]) ** 2 * (to_strike @ to_strike.T)
    root = np.linalg.cholesky(errors + by_turn)
    standard = np.linalg.solve(root, np.tile(angle[:, None], (len(FACTORS), 1, 1)))[..., 0]
    log_det = np.sum(np.log(np.diagonal(root, axis1=1, axis2=2)), axis=1)
    prior = factor_log_prior(FACTORS, PRIOR_SCALE, PRIOR_FREEDOM)
    return prior - 0.5 * np.sum(standard**2, axis=1) - log_det


def _total(density: Array) -> float:
    """Logarithm of the sum of densities whose logarithms (n,) are given."""
    return float(density.max() + np.log(np.sum(np.exp(density - density.max()))))
