"""Simulation of a strike on a rounded edge with dry friction: whether the edge holds (method 1.6).

The body turns about the centre line P of an edge that rolls on the table. A half-sine push of the striker
acts along the table at height h, then only gravity and the contact. At every instant the edge is tried as
sticking; where it would need more friction than there is, it slides. In the plane across the edge this is
exact for a rigid body. Out of that plane, a centre of mass that does not lie beside the strike and a tilted
principal axis must be held by the edge's two ends (yaw and roll); where they cannot, the body yaws.

Not modelled: the striker's friction, the compliance of mat and striker, a rim that rolls away sideways.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from analyze.planning.pivots import PivotAxis, Swing
from analyze.types import Array

SLIP_LIMIT = 3e-4
"""Largest slip of an edge before balance [m]: it has no noticeable effect on the fit of the motion."""
CONTACT_TIME = 0.003
"""Contact time of a strike [s]."""
PUSH_STEPS = 24
"""Integration steps during contact."""
FREE_STEP = 2e-3
"""Integration step after contact [s]."""
STEPS_BETWEEN_CHECKS = 10
"""Steps after which ended strikes are dropped; divides `MAX_FREE_TIME` / `FREE_STEP`."""
MAX_FREE_TIME = 0.9
"""Simulated time after the strike [s]; a body that still rises then is nearly balanced, where nothing
slides."""
STICTION_SPEED = 1e-7
"""Speed below which a contact counts as sticking [m/s]."""
FRICTIONS = np.array(
    [0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6, 0.65, 0.7, 0.8, 0.9, 1.0, 1.3, 2.0]
)
"""Friction coefficients tried to find the smallest that holds."""


@dataclass(frozen=True)
class StrikeCase:
    """One strike on one edge, in the world frame W at rest.

    W has x in the direction in which the object tips, y along the edge with y = 0 at the impact point, z up
    and the table at z = 0. c is the object's centre of mass; the edge is rounded, and its centre line is the
    axis of the rounding.
    """

    distance: float
    """Distance R of c from the centre line [m]."""
    phi: float
    """Balance angle [rad]."""
    i_com: float
    """Moment of inertia about the axis through c parallel to the edge [kg m^2]."""
    mass: float
    """Mass [kg]."""
    radius: float
    """Radius rho of the edge's rounding [m]."""
    height: float
    """Impact height over the table [m]."""
    impulse: float
    """Impulse of the strike [N s]."""
    friction: float
    """Friction coefficient between edge and table."""
    beside: float = 0.0
    """y of c [m]."""
    i_xy: float = 0.0
    """Entry xy of the inertia tensor about c, -sum(m x y) [kg m^2]."""
    i_zy: float = 0.0
    """Entry zy of the inertia tensor about c [kg m^2]."""
    i_zz: float = np.inf
    """Entry zz of the inertia tensor about c [kg m^2]; infinite to neglect yaw."""
    low: float = 0.0
    """y of the edge's lower end [m]."""
    high: float = 0.0
    """y of the edge's upper end [m]; equal to `low` if not known: no moments out of the plane."""
    duration: float = CONTACT_TIME
    """Contact time [s]."""


@dataclass(frozen=True)
class TipOutcomes:
    """Results of n simulated strikes: slip [m], smallest load on the edge, and whether balance is reached.

    The load is the table's normal force over the object's weight. A strike is simulated up to balance, or to
    the instant at which its tip ends before it.
    """

    slip: Array
    """(n,) largest displacement of the contact, or of an end of it, relative to rolling [m]."""
    least_load: Array
    """(n,) smallest normal force over weight after the strike; 0 or less if the edge leaves the table."""
    over: NDArray[np.bool_]
    """(n,) True if the body reaches balance, or has not come to rest after `MAX_FREE_TIME`."""


def strike_case(
    axis: PivotAxis,
    expected: Swing,
    com: Array,
    unit_inertia: Array,
    height: float,
    impulse: float,
    friction: float,
) -> StrikeCase:
    """Simulation input for a strike on one axis.

    Args:
        axis: Pivot axis (edge about which the object tips).
        expected: Expected swing (parameters of the tip) about it.
        com: (3,) centre of mass c [m], in the object frame.
        unit_inertia: (3, 3) inertia about c per kilogram [m^2], in the object frame.
        height: Impact height over the table [m].
        impulse: Impulse of the strike [N s].
        friction: Friction coefficient between edge and table.

    Returns:
        The case in the world frame at rest, with the usual contact time.
    """
    R = axis.R_world_object
    inertia = expected.mass * R @ unit_inertia @ R.T
    low, high = axis_ends(axis)
    return StrikeCase(
        distance=expected.distance,
        phi=expected.phi,
        i_com=float(inertia[1, 1]),
        mass=expected.mass,
        radius=axis.radius,
        height=height,
        impulse=impulse,
        friction=friction,
        beside=float(axis.direction @ (com - axis.point)),
        i_xy=float(inertia[0, 1]),
        i_zy=float(inertia[2, 1]),
        i_zz=float(inertia[2, 2]),
        low=low,
        high=high,
    )


def axis_ends(axis: PivotAxis) -> tuple[float, float]:
    """Places [m] of the two ends of an axis's edge, measured along the axis from the strike.

    The first is below 0, the second above. The radius stated for all edges also rounds the corners: with it,
    the edge ends one radius before each corner. A rim, which touches the table in one point, gives 0, 0.
    """
    if axis.rolls:
        return 0.0, 0.0
    along = sorted(float(axis.direction @ (corner - axis.point)) for corner in axis.edge)
    # A rounding of all edges rounds the corners too; a moulded one begins where the known face ends.
    inset = 0.0 if axis.moulded else axis.radius
    return min(along[0] + inset, -1e-4), max(along[1] - inset, 1e-4)


def simulate_tips(cases: Sequence[StrikeCase], gravity: float, most_slip: float = np.inf) -> TipOutcomes:
    """Simulate n strikes with the tips that follow, up to balance, all at once.

    Axes: x is the direction of tipping, y runs along the edge, z up. theta is the tipping angle, phi the
    balance angle, b = phi - theta, m the mass, mu the friction coefficient. P is the centre line of the
    edge's rounding (radius rho); c = (x_c, y_c, z_c) is the centre of mass at distance R from P, z_c = rho +
    R*cos b; I_c is the moment of inertia about the line through c along y.

    In the plane across the edge, the contact slides at the speed u = dx_P/dt - rho*theta'. F and N are the
    table's forces on the edge along x and z, S is the striker's push at height h: m*x_c'' = F + S, m*z_c'' =
    N - m*g, I_c*theta'' = (h - z_c)*S - z_c*F - R*sin b*N. While the contact sticks, u' = 0; while it slides,
    F = -mu*N*sign u. A body that is pushed too little to rise stays on its whole face.

    Out of that plane, the moments about x and z through the contact must be M_x = I_xy*theta'' +
    I_zy*theta'^2 + m*g*y_c and M_z = I_zy*theta'' - I_xy*theta'^2, with I_xy and I_zy entries of the turned
    body's inertia tensor about the contact. The edge's two ends, at y1 and y2, share them: y1*N1 + y2*N2 =
    M_x, y1*F1 + y2*F2 = -M_z.

    A case ends at balance, where it rocks back or the edge leaves the table, and after `MAX_FREE_TIME`.

    Args:
        cases: The n strikes.
        gravity: Gravity g [m/s^2].
        most_slip: Slip [m] at which a case ends too.

    Returns:
        For each case: largest slip, smallest load (normal force over weight), and True if balance is reached,
        or the body still moves after `MAX_FREE_TIME`; empty arrays without cases.
    """
    if not cases:
        return TipOutcomes(np.zeros(0), np.zeros(0), np.zeros(0, dtype=bool))
    body = _Bodies(cases, gravity)
    step = body.duration / PUSH_STEPS
    peak = body.impulse * np.pi / 2 / body.duration
    for i in range(PUSH_STEPS):
        body.step(step, peak * float(np.sin(np.pi * (i + 0.5) / PUSH_STEPS)))
    body.load_counts, body.most_slip = True, most_slip
    result = TipOutcomes(body.slip.copy(), body.least_load.copy(), np.zeros(len(cases), dtype=bool))
    going = np.arange(len(cases))
    for i in range(1, round(MAX_FREE_TIME / FREE_STEP) + 1):
        body.step(np.full(len(going), FREE_STEP), np.zeros(len(going)))
        if i % STEPS_BETWEEN_CHECKS == 0 or not body.goes_on.any():
            # Cases that have ended no longer change.
            result.slip[going], result.least_load[going] = body.slip, body.least_load
            result.over[going] = (body.theta >= body.phi) | body.goes_on
            going = going[body.goes_on]
            if not len(going):
                break
            body = body.still_moving()
    return result


def least_friction(cases: Sequence[StrikeCase], gravity: float) -> Array:
    """Smallest friction coefficients (n,) with which the edge slides at most `SLIP_LIMIT` in n strikes.

    The coefficient is one of `FRICTIONS` (0.05 apart up to 0.7, then farther). With it, and with all larger
    ones, the edge holds. It is inf if the edge slides even with the largest.

    Args:
        cases: The n strikes; their own friction is ignored.
        gravity: Gravity [m/s^2].
    """
    many = len(FRICTIONS)
    tried = [replace(each, friction=mu) for each in cases for mu in FRICTIONS.tolist()]
    fails = (simulate_tips(tried, gravity, SLIP_LIMIT).slip > SLIP_LIMIT).reshape(len(cases), many)
    # The smallest above which all hold: slip is not monotonic in mu (a sliding edge may happen to stop
    # early).
    last = np.where(fails.any(axis=1), many - np.argmax(fails[:, ::-1], axis=1), 0)
    return np.append(FRICTIONS, np.inf)[last]


class _Bodies:
    """Parameters and state of n simulated strikes, as arrays (n,).

    The state is the tipping angle theta [rad] and its rate, the contact's sliding speed [m/s] and distance
    [m], the yaw [rad] and its rate, the largest slip so far [m], the smallest load so far (normal force over
    weight), and whether the case goes on. While `load_counts` is False, during the striker's push, no load is
    recorded and no case ends; `simulate_tips` sets it to True afterwards.

    Args:
        cases: The n strikes.
        gravity: Gravity [m/s^2].
    """

    def __init__(self, cases: Sequence[StrikeCase], gravity: float) -> None:
        table = {
            field.name: np.array([getattr(each, field.name) for each in cases], dtype=np.float64)
            for field in fields(StrikeCase)
        }
        self._p = table
        self._g = gravity
        self.phi, self.duration, self.impulse = table["phi"], table["duration"], table["impulse"]
        self._reach = np.maximum(np.abs(table["low"]), np.abs(table["high"]))
        self._has_ends = table["high"] > table["low"]
        self._length = np.where(self._has_ends, table["high"] - table["low"], 1.0)
        n = len(cases)
        self.theta, self._rate, self._slid, self._u, self.slip = (np.zeros(n) for _ in range(5))
        self._yaw, self._yaw_rate = np.zeros(n), np.zeros(n)
        self.least_load = np.full(n, np.inf)
        self.goes_on = np.ones(n, dtype=bool)
        self.load_counts = False
        self.most_slip = np.inf

    def still_moving(self) -> _Bodies:
        """Copy, with parameters and state, of only those simulated strikes that still go on."""
        rest = _Bodies.__new__(_Bodies)
        for name, value in vars(self).items():
            setattr(rest, name, value[..., self.goes_on] if isinstance(value, np.ndarray) else value)
        rest._p = {name: value[self.goes_on] for name, value in self._p.items()}
        return rest

    def step(self, dt: Array, push: Array) -> None:
        """Advance all strikes whose simulation goes on by one semi-implicit Euler step, in place.

        Args:
            dt: (n,) time steps [s].
            push: (n,) horizontal forces of the striker [N].
        """
        p, g = self._p, self._g
        m, mu, i_com, h = p["mass"], p["friction"], p["i_com"], p["height"]
        b = self.phi - self.theta
        s, c = p["distance"] * np.sin(b), p["distance"] * np.cos(b)
        z = p["radius"] + c
        square = self._rate**2
        turning = (h * push - m * s * (g + p["radius"] * square)) / (i_com + m * (z**2 + s**2))
        load = m * (g + s * turning - c * square)
        shear = m * (z * turning + s * square) - push
        flat = (self.theta <= 0) & (turning <= 0) & (self._rate <= 0)
        turning = np.where(flat, 0.0, turning)
        load = np.where(flat, m * g, load)
        shear = np.where(flat, -push, shear)
        self._turn(dt, turning, load, shear, flat, s, z)
        moving = np.abs(self._u) > STICTION_SPEED
        slides = moving | (np.abs(shear) > mu * load)
        # Friction acts against the motion, or against the direction in which the contact would start to
        # slide.
        way = np.where(moving, np.sign(self._u), -np.sign(shear))
        lever = way * mu * z - s
        # Where dry friction would jam (Painleve), the inertia is bounded below.
        inertia = np.maximum(i_com - m * s * lever, 0.05 * i_com)
        skidding = ((h - z) * push + lever * m * (g - c * square)) / inertia
        skidding = np.where((self.theta <= 0) & (self._rate <= 0), np.maximum(skidding, 0.0), skidding)
        turning = np.where(slides, skidding, turning)
        load = np.where(slides, np.where(skidding == 0.0, m * g, m * (g + s * skidding - c * square)), load)
        faster = (-way * mu * np.maximum(load, 0.0) + push) / m - z * turning - s * square
        u = np.where(slides, self._u + dt * faster, 0.0)
        # Friction stops a contact, it does not reverse it.
        u = np.where(moving & (u * self._u < 0), 0.0, u)
        self._advance(dt, turning, u, load / (m * g))

    def _advance(self, dt: Array, turning: Array, u: Array, load: Array) -> None:
        """Advance n simulated strikes by a time step, in place: motion, largest slip and smallest load.

        The motion is tipping, sliding and yaw (turn about the vertical); strikes that ended do not change.
        Only after the striker's push does the load count, and are strikes that reach balance, rock back, lift
        off or slip by more than `most_slip` marked as ended.

        Args:
            dt: (n,) time steps [s].
            turning: (n,) angular accelerations [rad/s^2].
            u: (n,) new sliding speeds of the contact [m/s].
            load: (n,) normal forces over weight.
        """
        go = self.goes_on
        self._u = np.where(go, u, self._u)
        self._rate = np.where(go, self._rate + dt * turning, self._rate)
        self.theta = np.where(go, np.maximum(self.theta + dt * self._rate, 0.0), self.theta)
        self._rate = np.where((self.theta <= 0) & (self._rate < 0), 0.0, self._rate)
        self._slid = np.where(go, self._slid + dt * self._u, self._slid)
        self._yaw = np.where(go, self._yaw + dt * self._yaw_rate, self._yaw)
        by_yaw = self._reach * np.abs(self._yaw)
        self.slip = np.maximum(self.slip, np.maximum(np.abs(self._slid), by_yaw))
        if self.load_counts:
            self.least_load = np.where(go, np.minimum(self.least_load, load), self.least_load)
            rocks_back = (self._rate <= 0) & (np.abs(self._u) <= STICTION_SPEED)
            self.goes_on = (
                go
                & (self.theta < self.phi)
                & np.logical_not(rocks_back)
                & (load > 0)
                & (self.slip <= self.most_slip)
            )

    def _turn(
        self,
        dt: Array,
        turning: Array,
        load: Array,
        shear: Array,
        flat: NDArray[np.bool_],
        s: Array,
        z: Array,
    ) -> None:
        """Update the yaw rates, in place, where the friction at the edge's ends cannot prevent yaw.

        They are the bodies' angular rates (n,) [rad/s] about the vertical in n simulated strikes
        (`_yaw_rate`). The yaw does not act back on the motion in the plane across the edge.

        Args:
            dt: (n,) time steps [s].
            turning: (n,) angular accelerations theta'' [rad/s^2] without sliding.
            load: (n,) normal forces at the edge [N].
            shear: (n,) horizontal forces of the table on the edge in the direction of the tip [N], without
                sliding.
            flat: (n,) True where the body stands on its whole face, which prevents yaw.
            s: (n,) horizontal distance [m] of the contact ahead of the centre of mass.
            z: (n,) height of the centre of mass over the table [m].
        """
        p = self._p
        m, square, y = p["mass"], self._rate**2, p["beside"]
        sine, cosine = np.sin(self.theta), np.cos(self.theta)
        # The tensor turns with the body; c stands at (-s, y, z) from the contact.
        i_xy = cosine * p["i_xy"] + sine * p["i_zy"] + m * s * y
        i_zy = cosine * p["i_zy"] - sine * p["i_xy"] - m * z * y
        roll = i_xy * turning + i_zy * square + m * self._g * y
        yaw = i_zy * turning - i_xy * square
        low, high, room = p["low"], p["high"], np.maximum(load, 0.0)
        at_low = p["friction"] * np.minimum(np.maximum((high * load - roll) / self._length, 0.0), room)
        at_high = p["friction"] * np.minimum(np.maximum((roll - low * load) / self._length, 0.0), room)
        # F at the low end, required and allowed by the two ends' friction; the other end carries the rest of
        # the shear.
        least, greatest = np.maximum(-at_low, shear - at_high), np.minimum(at_low, shear + at_high)
        middle = (least + greatest) / 2
        least, greatest = np.minimum(least, middle), np.maximum(greatest, middle)
        wanted = (high * shear + yaw) / self._length
        turns = np.abs(self._yaw_rate) > STICTION_SPEED
        held: Array = np.minimum(np.maximum(wanted, least), greatest)
        forwards = np.asarray(self._yaw_rate > 0, dtype=np.float64)
        against = forwards * least + (1 - forwards) * greatest
        given = held + turns * (against - held)
        rate = self._yaw_rate + dt * self._length * (given - wanted) / p["i_zz"]
        rate = np.where(turns & (rate * self._yaw_rate < 0), 0.0, rate)
        self._yaw_rate = np.where(self._has_ends & np.logical_not(flat), rate, 0.0)
