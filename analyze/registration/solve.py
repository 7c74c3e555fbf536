"""Registration's least squares; one file, as model, derivatives and elimination share a layout.

Marker poses, placements and the table's plane are solved together from the markers' corners.

A corner q of a marker (in the marker frame M) is carried by the body's motion to the object frame O, the
world frame W and the camera frame C::

    x_O = R_m q + t_m
    a   = Rz(alpha + d_alpha) R_s (x_O - c_e) + R_s (c_e - p_e - U d_e)
    x_W = Rz(h) [Rz(psi + kappa + tau theta + d_psi) Ry(theta) a + (x + d_x, y + d_y, rho + d_z)]
    x_C = T_camera_world E x_W

m: marker, s: strike, e: edge. R_m and t_m are the marker's pose on the object, theta is the tipping angle.
kappa is the turn about the vertical by the impact, tau that while it tips per rad of theta, d_e (2 numbers)
the error of the edge's position across itself, and U (3, 2) the two unit directions across the edge in O. Of
a placement, R_s is known except for its heading psi, and the centre line p_e of the edge's rounding is at the
height of its radius rho over the table; psi, x and y are as the hand left them. While the body tips over the
edge, theta is free in every frame; a small heading d_psi, the edge's sliding (d_x, d_y) along the table and
its height d_z are 0 to within FRAME_SD (0.05 deg; 20 mm and 0.2 mm; 0.03 mm). E is the pose of the table
relative to the recorded T_world_camera: two tilts and a height; h is the planned heading of object and
striker on the table. Over a straight edge alpha and d_alpha are 0. A round rim, a circle about the axis
through c_e, may stand on another of its points (alpha, as the hand left it), and while it tips it yaws and
rolls (RIM_FRAME_SD); what remains sure is that the lowest point of the rim stays on the table. Frames are
eliminated one by one (Schur complement): docs/decisions/0028 gives the reason why this solver is not the
dense one.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import EstimationError
from analyze.geometry.rotations import hat, matrix_from_vector, plane_basis
from analyze.registration.round_body import rim_axis
from analyze.registration.solution import Solution
from analyze.registration.table import table_rotation, tilt_axes
from analyze.registration.unknowns import (
    DRIFT_SD,
    FRAME_SD,
    HEADING_SD,
    IMPACT_TURN_SD,
    MARKER_SD,
    PER_EDGE,
    PER_FRAME,
    PER_STRIKE,
    PER_TABLE,
    PLACE_SD,
    RIM_DRIFT_SD,
    RIM_FRAME_SD,
    SIZE_SD,
    TWISTED_SD,
    Unknowns,
    heading_by_frame,
)
from analyze.tracking.camera_model import project_ideal, project_jacobian, world_to_camera
from analyze.tracking.pose import marker_corners

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from analyze.registration.round_body import FreeTurn
    from analyze.registration.surface import Surface
    from analyze.registration.table import TablePrior
    from analyze.registration.views import StrikeView
    from analyze.types import Array, IntArray

_MAX_STEPS = 40
_COST_TOLERANCE = 1e-7
"""relative decrease of the cost below which the iteration ends"""
_MAX_DAMPING = 1e8
_OUTLIER_CHI2_RATIO = 25.0
"""multiple of the median chi^2 of a strike's frames above which a frame is left out"""


class Problem:
    """Least-squares problem of marker poses, placements and tables in some strikes.

    Args:
        views: views of the strikes: marker corners at rest and while the object tips.
        sizes: edge of each marker's black square [m].
        table: prior sd of each table's tilts and height in the world frame W, which the recorded camera pose
            T_world_camera defines.
        surface: the body's surface, with the markers constrained to it.
        twisted: ids of the strikes whose impact clearly turned the body about the vertical; the prior
            standard deviation of that turn is 3 deg for these, 0.05 deg for the others.
        free: axis of a body of revolution, about which the first marker defines O's direction: errors are
            those against it. None if the shape or an edge shows how the body is turned.
    """

    def __init__(
        self,
        views: Sequence[StrikeView],
        sizes: Mapping[int | str, float],
        table: TablePrior,
        surface: Surface,
        twisted: Collection[str] = (),
        free: FreeTurn | None = None,
    ) -> None:
        """Lay out the vector of unknowns: of markers, strikes, edges, tables and sizes, in this order.

        They are the markers' poses, the strikes' placements, and corrections of the edges' places, of the
        tables' planes, and of the markers' sizes.
        """
        self._impact_turn_sd = [
            TWISTED_SD if view.strike_id in twisted or view.on_rim else IMPACT_TURN_SD for view in views
        ]
        self._frame_weight = [1.0 / (RIM_FRAME_SD if view.on_rim else FRAME_SD) for view in views]
        self._views = list(views)
        self._surface, self._free = surface, free
        self._axis = rim_axis(views)
        self.setups = sorted({view.setup for view in views})
        self.markers: list[int | str] = list(dict.fromkeys(i for view in views for i in view.marker_ids))
        self._edges = list(dict.fromkeys(view.axis_id for view in views))
        self._basis = [
            np.stack(plane_basis(next(v.direction for v in views if v.axis_id == edge)), axis=-1)
            for edge in self._edges
        ]
        self._edge_sd = np.array(
            [max(next(v.pivot_sd for v in views if v.axis_id == edge), 1e-6) for edge in self._edges]
        )
        self._table_sd = np.tile([table.tilt_sd, table.tilt_sd, table.height_sd], len(self.setups))
        self._corners = {i: marker_corners(sizes[i]) for i in self.markers}
        self._seen = [np.isfinite(view.sd) for view in views]
        self._strike_at = 6 * len(self.markers)
        self._edge_at = self._strike_at + PER_STRIKE * len(self._views)
        self._table_at = self._edge_at + PER_EDGE * len(self._edges)
        self._size_at = self._table_at + PER_TABLE * len(self.setups)

    def solve(self, start: Mapping[int | str, Array]) -> Solution:
        """Fit marker poses on the object, its placement in each strike, and table poses, to all corners seen.

        Single misread frames are left out, and the fit is then repeated.

        Args:
            start: first pose T_object_marker (4, 4) per marker, near the true one.

        Returns:
            Marker poses (in the object frame O) and table poses (in the world frame W) with covariances.

        Raises:
            EstimationError: the iteration diverges.
        """
        unknowns, normal, converged = self._minimum(self._first(start))
        if self._drop_outliers(unknowns):
            unknowns, normal, converged = self._minimum(unknowns)
        return self._solution(unknowns, normal, converged)

    def _first(self, start: Mapping[int | str, Array]) -> Unknowns:
        """First values of all unknowns (markers, strikes, edges, tables, frames), where the fit begins.

        Markers have the given poses; objects lie and edges run as planned; tables lie as recorded; frames
        have the tipping angles first guessed from the images.

        Args:
            start: first pose T_object_marker (4, 4) per marker, its translation in m.
        """
        return Unknowns(
            [start[i][:3, :3] for i in self.markers],
            [start[i][:3, 3] for i in self.markers],
            np.zeros((len(self._views), PER_STRIKE)),
            np.zeros((len(self._edges), PER_EDGE)),
            np.zeros((len(self.setups), PER_TABLE)),
            np.zeros(len(self.markers)),
            [view.theta[1:, None] * np.eye(PER_FRAME)[0] for view in self._views],
        )

    def _minimum(self, unknowns: Unknowns) -> tuple[Unknowns, Array, bool]:
        """Minimise the registration's cost by Levenberg-Marquardt, over all unknowns.

        The cost is the sum of squared deviations (corners, priors, surface) over their sd. The n shared
        unknowns are those of markers, strikes, edges and tables; each frame after rest has five of its own
        (tipping angle, heading, position).

        Args:
            unknowns: values from which the iteration starts.

        Returns:
            The unknowns at the minimum; the normal matrix (n, n) there of the shared unknowns, with the
            frames' own unknowns eliminated; and False if the cost still fell at the last step allowed.

        Raises:
            EstimationError: the cost is not finite.
        """
        damping, cost, converged = 1e-4, self._cost(unknowns), True
        for _ in range(_MAX_STEPS):
            normal, gradient, back = self._normal(unknowns)
            better: tuple[float, Unknowns] | None = None
            while better is None and damping < _MAX_DAMPING:
                step: Array = np.asarray(
                    np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient), dtype=np.float64
                )
                tried = unknowns.after_step(step, back(step), self._axis)
                new = self._cost(tried)
                if new <= cost * (1 + 1e-12):
                    better = new, tried
                else:
                    damping *= 10.0
            if better is None:
                break
            gained, (cost, unknowns), damping = cost - better[0], better, max(damping * 0.1, 1e-12)
            if gained < _COST_TOLERANCE * (1 + cost):
                break
        else:
            converged = False
        if not math.isfinite(cost):
            raise EstimationError("the markers' places do not converge")
        return unknowns, self._normal(unknowns)[0], converged

    def _model(self, s: int, u: Unknowns) -> tuple[Array, Array, Array, Array]:
        """Modelled marker corners of strike s in the camera frame, with three intermediate results.

        Each of the four arrays is (f, m, 4, 3) [m] for f frames and m markers of four corners. In order:

        - corners in the camera frame;
        - vectors from pivot point to corner, turned about a rim's axis and by the tipping angle theta;
        - these vectors turned by the heading (about the vertical) as well;
        - corners in axes of the recorded world frame W, the table's height left out.

        Args:
            s: index of the strike.
            u: values of the unknowns.
        """
        view = self._views[s]
        e = self._edges.index(view.axis_id)
        _, x, y, *_, alpha = u.strike[s]
        pivot = view.p_object_pivot + self._basis[e] @ u.edge[e]
        numbers = [self.markers.index(name) for name in view.marker_ids]
        on_body = np.stack([self._arms(j, u) + u.t[j] for j in numbers])
        frame = np.concatenate([np.zeros((1, PER_FRAME)), u.frames[s]])
        if view.rim_centre is None:
            arm = ((on_body - pivot) @ view.R_world_object.T)[None]
        else:
            rolled = _turns(2, alpha + frame[:, 2]).transpose(0, 2, 1)[:, None]
            arm = ((on_body - view.rim_centre) @ view.R_world_object.T)[None] @ rolled
            arm += (view.rim_centre - pivot) @ view.R_world_object.T
        B = arm @ _turns(1, frame[:, 0]).transpose(0, 2, 1)[:, None]
        C = B @ _turns(2, heading_by_frame(u.strike[s], frame)).transpose(0, 2, 1)[:, None]
        place = frame[:, 3:] + np.array([x, y, view.radius])
        table = u.table[self.setups.index(view.setup)]
        world = (C + place[:, None, None, :]) @ self._on_table(view, table).T
        R_camera_world, t_camera_world = world_to_camera(view.camera)
        return (world + np.array([0, 0, table[2]])) @ R_camera_world.T + t_camera_world, B, C, world

    def _arms(self, j: int, u: Unknowns) -> Array:
        """Vectors (4, 3) [m] in O from the centre of marker number j to its corners."""
        return (1 + u.size[j]) * self._corners[self.markers[j]] @ u.R[j].T

    @staticmethod
    def _on_table(view: StrikeView, table: Array) -> Array:
        """Rotation (3, 3) from a strike's frame, turned by its heading on the table, to the recorded W.

        Args:
            view: view of the strike, with its heading [rad].
            table: (3,) tilts of the table [rad] and its height [m].
        """
        return table_rotation(table) @ matrix_from_vector(np.array([0.0, 0.0, view.heading]))

    def _weight(self, s: int) -> Array:
        """Weights (f, m) [1/px] of corners in strike number `s`, per frame and marker; 0 if it is not seen.

        A weight is the inverse of the corners' standard deviation.
        """
        return np.where(self._seen[s], 1.0 / self._views[s].sd, 0.0)

    def _residual(self, s: int, in_camera: Array) -> Array:
        """Residuals (f, m, 4, 2) of strike s: corners seen less those modelled, in sd, within ±1e6.

        There are f frames, m markers of four corners, and two image coordinates.

        Args:
            s: index of the strike.
            in_camera: (f, m, 4, 3) modelled corners in the camera frame [m].
        """
        off = self._views[s].ideal - project_ideal(self._views[s].camera, in_camera)
        return np.clip(off * self._weight(s)[:, :, None, None], -1e6, 1e6)

    def _prior(self, u: Unknowns) -> tuple[Array, Array]:
        """Deviations (n,) of the shared unknowns `u` from their priors, and their weights (n,).

        Shared by all frames are the unknowns of markers, strikes, edges, tables and sizes, in this order, in
        rad and m, sizes relative. Weights are reciprocal standard deviations. The deviation of a marker's
        pose is always 0: its prior only keeps undetermined directions finite.
        """
        value = np.concatenate(
            [np.zeros(6 * len(self.markers)), u.strike.ravel(), u.edge.ravel(), u.table.ravel(), u.size]
        )
        sd = np.concatenate(
            [
                np.tile(MARKER_SD, len(self.markers)),
                np.ravel(
                    [
                        [
                            HEADING_SD,
                            PLACE_SD,
                            PLACE_SD,
                            turn_sd,
                            RIM_DRIFT_SD if view.on_rim else DRIFT_SD,
                            HEADING_SD,
                        ]
                        for view, turn_sd in zip(self._views, self._impact_turn_sd, strict=True)
                    ]
                ),
                np.repeat(self._edge_sd, PER_EDGE),
                self._table_sd,
                np.full(len(self.markers), SIZE_SD),
            ]
        )
        return value, 1.0 / sd

    def _off_surface(self, u: Unknowns) -> list[tuple[int, Array, Array]]:
        """Deviation from the surface of each marker held to it: list of (index, deviation, derivative).

        The index is that of the marker in `markers`. The deviation (3,) has the marker's height over the
        surface less its card's thickness, and its two tilts against the surface, each over its standard
        deviation. The derivative (3, 6) of these three is by the marker's turn (3) [rad] and position (3) [m]
        in the object frame.
        """
        found: list[tuple[int, Array, Array]] = []
        for j, name in enumerate(self.markers):
            fit = self._surface.fits.get(name)
            if fit is None:
                continue
            height, normal = self._surface.height(u.t[j])
            across = np.stack(plane_basis(normal))
            off = np.array(
                [
                    (height - fit.thickness) / fit.height_sd,
                    *(across @ np.cross(normal, u.R[j][:, 2])) / fit.tilt_sd,
                ]
            )
            by = np.zeros((3, 6))
            by[0, 3:] = normal / fit.height_sd
            by[1:, :3] = across / fit.tilt_sd
            found.append((j, off, by))
        return found

    def _cost(self, u: Unknowns) -> float:
        """Cost of the unknowns `u`, unitless: sum of squared deviations, each over its standard deviation.

        The deviations are those of seen from modelled marker corners, of the unknowns from their priors, and
        of markers from the object's surface.
        """
        total = 0.0
        for s in range(len(self._views)):
            total += float(np.sum(self._residual(s, self._model(s, u)[0]) ** 2))
            total += float(np.sum((u.frames[s] * self._frame_weight[s]) ** 2))
        value, weight = self._prior(u)
        return (
            total
            + float(np.sum((value * weight) ** 2))
            + sum(float(off @ off) for _, off, _ in self._off_surface(u))
        )

    def _normal(self, u: Unknowns) -> tuple[Array, Array, Callable[[Array], list[Array]]]:
        """Normal matrix (n, n) and gradient (n,) of the shared unknowns, and a function for frame steps.

        Shared are the unknowns of markers, strikes, edges and tables; the frames' own unknowns are
        eliminated. The function gives the steps of the frames' own unknowns (tipping angle, heading, turn
        about the rim's axis, x, y, z [rad, rad, rad, m, m, m]), (f - 1, 6) per strike of f frames, for a step
        (n,) of the shared ones. The gradient is minus the derivative of half the cost.
        """
        value, weight = self._prior(u)
        normal, gradient = np.diag(weight**2), -value * weight**2
        for j, off, by in self._off_surface(u):
            at = slice(6 * j, 6 * j + 6)
            normal[at, at] += by.T @ by
            gradient[at] -= by.T @ off
        kept: list[tuple[IntArray, Array, Array, Array]] = []
        for s in range(len(self._views)):
            columns, J, own, residual = self._jacobian(s, u)
            # At rest a frame has no unknowns of its own.
            at = np.ix_(columns, columns)
            normal[at] += J[0].T @ J[0]
            gradient[columns] += J[0].T @ residual[0]
            tip, own, residual = J[1:], own[1:], residual[1:]
            held = own.transpose(0, 2, 1) @ own + np.diag(self._frame_weight[s] ** 2 + 1e-12)
            of_frames: Array = np.asarray(np.linalg.inv(held), dtype=np.float64)
            across = own.transpose(0, 2, 1) @ tip
            right = (own.transpose(0, 2, 1) @ residual[..., None])[..., 0] - u.frames[s] * (
                self._frame_weight[s] ** 2
            )
            reduced = of_frames @ across
            normal[at] += np.einsum("fki,fkj->ij", tip, tip) - np.einsum("fki,fkj->ij", across, reduced)
            gradient[columns] += np.einsum("fki,fk->i", tip, residual) - np.einsum(
                "fki,fk->i", reduced, right
            )
            kept.append((columns, of_frames, across, right))

        def back(step: Array) -> list[Array]:
            """Steps of the frames' own unknowns that go with a step (n,) of the shared unknowns.

            They are a list of arrays (f - 1, 6), one per strike of f frames; the frame at rest has none. The
            unknowns are tipping angle, heading, turn about the rim's axis and x, y, z of the object [rad,
            rad, rad, m, m, m]; shared are those of markers, strikes, edges and tables.
            """
            return [
                (inverse @ (right - across @ step[columns])[..., None])[..., 0]
                for columns, inverse, across, right in kept
            ]

        return normal, gradient, back

    def _jacobian(self, s: int, u: Unknowns) -> tuple[IntArray, Array, Array, Array]:
        """Derivatives of strike s's expected marker corners by the unknowns, and residuals of the corners.

        Both are divided by the corners' standard deviations. Corners are distortion-free pixels.

        Args:
            s: index of the strike.
            u: values of the unknowns.

        Returns:
            For f frames and k corner coordinates (8 per marker): (c,) indices of the shared unknowns (of
            markers, strike, edge, table); derivatives (f, k, c) by these; derivatives (f, k, 6) by a frame's
            own unknowns (tipping angle, heading, turn about the rim's axis [rad], position (3) [m]); and
            residuals (f, k).
        """
        view = self._views[s]
        e = self._edges.index(view.axis_id)
        in_camera, B, C, world = self._model(s, u)
        residual = self._residual(s, in_camera)
        R_camera_world, _ = world_to_camera(view.camera)
        setup = self.setups.index(view.setup)
        F, M = view.sd.shape
        frame = np.concatenate([np.zeros((1, PER_FRAME)), u.frames[s]])
        theta, heading, tau = frame[:, 0], _turns(2, heading_by_frame(u.strike[s], frame)), u.strike[s, 4]
        out = R_camera_world @ self._on_table(view, u.table[setup])
        tipped = out @ heading @ _turns(1, theta)
        pivots = tipped @ view.R_world_object
        rolled = _turns(2, u.strike[s, 5] + frame[:, 2])
        carry = tipped @ rolled @ view.R_world_object if view.on_rim else pivots
        by_point = project_jacobian(view.camera, in_camera) * self._weight(s)[:, :, None, None, None]
        columns: list[IntArray] = []
        parts: list[Array] = []
        for j, name in enumerate(view.marker_ids):
            number = self.markers.index(name)
            arms = self._arms(number, u)
            by = np.zeros((F, M, 4, 3, 7))
            by[:, j, :, :, :3] = carry[:, None] @ -hat(arms)[None]
            by[:, j, :, :, 3:6] = carry[:, None]
            by[:, j, :, :, 6] = arms @ carry.transpose(0, 2, 1)
            columns.append(np.append(np.arange(6 * number, 6 * number + 6), self._size_at + number))
            parts.append(by_point @ by)
        about_up = np.cross(np.array([0.0, 0.0, 1.0]), C) @ out.T
        tips: Array = np.minimum(np.arange(F, dtype=np.float64), 1.0)[:, None, None, None]
        turn_of = theta[:, None, None, None]
        columns.append(self._strike_at + PER_STRIKE * s + np.arange(PER_STRIKE))
        along = np.broadcast_to(out[:, :2], (*about_up.shape[:-1], 3, 2))
        about_rim = self._about_rim(s, u, rolled, tipped)
        of_strike = [
            about_up[..., None],
            along,
            (about_up * tips)[..., None],
            (about_up * turn_of)[..., None],
            about_rim[..., None],
        ]
        parts.append(by_point @ np.concatenate(of_strike, axis=-1))
        columns.append(self._edge_at + 2 * e + np.arange(2))
        parts.append(by_point @ np.broadcast_to((-pivots @ self._basis[e])[:, None, None], (F, M, 4, 3, 2)))
        columns.append(self._table_at + PER_TABLE * setup + np.arange(PER_TABLE))
        tilt = [np.cross(axis, world) @ R_camera_world.T for axis in tilt_axes(u.table[setup])]
        lifted = np.broadcast_to(R_camera_world[:, 2], world.shape)
        parts.append(by_point @ np.stack([*tilt, lifted], axis=-1))
        about_edge = np.cross(np.array([0.0, 1.0, 0.0]), B) @ heading.transpose(0, 2, 1)[:, None] @ out.T
        shift = np.broadcast_to(out, (*about_edge.shape[:-1], 3, 3))
        own = by_point @ np.concatenate(
            [
                (about_edge + tau * about_up)[..., None],
                about_up[..., None],
                about_rim[..., None],
                shift,
            ],
            axis=-1,
        )
        J = np.concatenate(parts, axis=-1).reshape(F, M * 8, -1)
        return np.concatenate(columns), J, own.reshape(F, M * 8, PER_FRAME), residual.reshape(F, M * 8)

    def _about_rim(self, s: int, u: Unknowns, rolled: Array, tipped: Array) -> Array:
        """Derivatives (f, m, 4, 3) of strike s's corners in the camera by the turn about the rim's axis [m].

        They are 0 over a straight edge.

        Args:
            s: index of the strike.
            u: values of the unknowns.
            rolled: (f, 3, 3) turn about the rim's axis in every frame.
            tipped: (f, 3, 3) rotation from the object, so turned, to the camera.
        """
        view = self._views[s]
        if view.rim_centre is None:
            return np.zeros((*view.sd.shape, 4, 3))
        numbers = [self.markers.index(name) for name in view.marker_ids]
        on_body = np.stack([self._arms(j, u) + u.t[j] for j in numbers])
        from_axis = ((on_body - view.rim_centre) @ view.R_world_object.T)[None]
        turned = np.cross(np.array([0.0, 0.0, 1.0]), from_axis @ rolled.transpose(0, 2, 1)[:, None])
        return turned @ tipped.transpose(0, 2, 1)[:, None]

    def _drop_outliers(self, u: Unknowns) -> bool:
        """Leave out markers misread in single tipping frames; return True if there were any.

        A marker in a frame is left out if the mean square of its 8 residuals (corner coordinates, in sd) is
        over 25 times the strike's median one (taken as at least 1); later fits count it as not seen.
        """
        dropped = False
        for s in range(len(self._views)):
            chi2 = np.mean(self._residual(s, self._model(s, u)[0]) ** 2, axis=(2, 3))
            seen = self._seen[s][1:]
            if not np.any(seen):
                continue
            bad = seen & (chi2[1:] > _OUTLIER_CHI2_RATIO * max(float(np.median(chi2[1:][seen])), 1.0))
            if np.any(bad):
                self._seen[s] = np.concatenate([self._seen[s][:1], seen & ~bad])
                dropped = True
        return dropped

    def _solution(self, u: Unknowns, normal: Array, converged: bool) -> Solution:
        """Solution at the minimum: poses of markers and tables with covariances, and how well they fit.

        How well they fit is given by chi^2 per degree of freedom of each strike and by the rms residual [px]
        of each marker.

        Args:
            u: values of the unknowns at the minimum.
            normal: (n, n) normal matrix of the shared unknowns (markers, strikes, edges, tables) there; its
                inverse, scaled by the residuals, is their covariance.
            converged: False if the iteration still moved.
        """
        chi2, freedom = 0.0, 0
        misfit: dict[str, float] = {}
        off_px: dict[int | str, list[float]] = {name: [] for name in self.markers}
        for s, view in enumerate(self._views):
            residual = self._residual(s, self._model(s, u)[0])
            tip = u.frames[s] * self._frame_weight[s]
            own = float(np.sum(residual**2) + np.sum(tip**2))
            # Of a frame's unknowns only theta and the slip are not fixed by their priors; over a rim only the
            # height is.
            shown = int(np.count_nonzero(np.any(self._seen[s][1:], axis=1)))
            free = 8 * int(np.count_nonzero(self._seen[s])) - (5 if view.on_rim else 2) * shown - 6
            misfit[view.strike_id] = own / max(free, 1)
            chi2 += own
            freedom += max(free, 1)
            px = residual * np.where(self._seen[s], view.sd, 0.0)[:, :, None, None]
            for j, name in enumerate(view.marker_ids):
                off_px[name] += np.sum(px[self._seen[s][:, j], j] ** 2, axis=-1).ravel().tolist()
        scale = math.sqrt(max(1.0, chi2 / freedom))
        covariance = self._against_first(np.asarray(np.linalg.inv(normal), dtype=np.float64) * scale**2)
        at = [self._table_at + PER_TABLE * i for i in range(len(self.setups))]
        T: dict[int | str, Array] = {}
        for j, name in enumerate(self.markers):
            T[name] = np.eye(4)
            T[name][:3, :3], T[name][:3, 3] = u.R[j], u.t[j]
        return Solution(
            T_object_marker=T,
            covariance={
                name: covariance[6 * j : 6 * j + 6, 6 * j : 6 * j + 6] for j, name in enumerate(self.markers)
            },
            table={setup: u.table[i] for i, setup in enumerate(self.setups)},
            table_covariance={
                setup: covariance[a : a + PER_TABLE, a : a + PER_TABLE]
                for setup, a in zip(self.setups, at, strict=True)
            },
            pulls={self.markers[j]: float(off[0]) for j, off, _ in self._off_surface(u)},
            misfit=misfit,
            rms_px={name: math.sqrt(float(np.mean(off))) if off else 0.0 for name, off in off_px.items()},
            converged=converged,
        )

    def _against_first(self, covariance: Array) -> Array:
        """Covariance (n, n) of the shared unknowns if the first marker defines O's direction about an axis.

        The first marker's turn about the axis of a body of revolution then has no error, as its value is a
        convention; a' P a is taken out of the covariance P, with a the derivative of that turn. Without such
        an axis the covariance is returned as given.
        """
        if self._free is None:
            return covariance
        by = covariance[:, :3] @ self._free.direction
        return covariance - np.outer(by, by) / float(by[:3] @ self._free.direction)


def _turns(axis: int, angle: Array) -> Array:
    """Rotations (n, 3, 3) by angles (n,) [rad] about the coordinate axis 0 (x), 1 (y) or 2 (z)."""
    vector = np.zeros((len(angle), 3))
    vector[:, axis] = angle
    return matrix_from_vector(vector)
