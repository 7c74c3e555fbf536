"""Client of the daemon for a single strike and for the calibration of a bare striker.

A person confirms every swing that may meet something.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from acquire.daemon.client import DaemonClient
from acquire.errors import ConfigError, SessionError, StrikerRefused
from acquire.striker.base import StrikeOutcome
from acquire.striker.calibration import MeasuredSwing, StrikerParameters
from schemas.input_file import read_text
from schemas.output_file import OutputError, write_text
from schemas.rig import RigConfig
from schemas.rig_limits import MIN_ARM_SPEED_RAD_S, tip_speeds
from schemas.toml_table import with_entry

Confirm = Callable[[str], bool]
"""asks the person at the rig; False if the answer is no"""
DEFAULT_SPEED_COUNT = 5
SLOWEST_FACTOR, RUN_UP_FACTOR = 1.2, 1.08
"""margins of a calibration's default speeds to the slowest and fastest speed that the striker accepts"""
SPEED_DECIMALS = 4
"""decimals of the default tip speeds in m/s"""
MAX_SWING_TRIES = 4
"""largest number of tries of one swing; a try fails if this host pauses for 60 ms, which stops the arm"""


@contextlib.contextmanager
def held_striker(client: DaemonClient) -> Iterator[None]:
    """Context manager in whose block the caller may strike; an exception in the block stops the striker.

    The exception is raised again. The block gets no value.

    Args:
        client: client of the daemon.

    Raises:
        SessionError: a session is running, which owns the striker.
    """
    recording = client.call("status")["recording"]
    if recording:
        raise SessionError(f"a session is running ({recording}) and uses the striker: end the session first")
    try:
        yield
    except BaseException:
        with contextlib.suppress(Exception), client.another() as other:
            other.call("striker.stop")
        raise


def strike_once(
    client: DaemonClient, name: str, tip_speed_m_s: float, confirm: Confirm, *, after_stop: bool = True
) -> StrikeOutcome:
    """Make one strike: ask the person, home if necessary, arm, cock (draw the arm back) and strike.

    Args:
        client: client of the daemon.
        name: id of the strike.
        tip_speed_m_s: tip speed to command [m/s].
        confirm: asks a person before anything moves; False refuses.
        after_stop: True if this call may home the striker again after somebody stopped it.

    Returns:
        Contact time [host monotonic ns], tip speed just before contact [m/s] and impulse on the object [N s],
        each with 1 sigma; number of contacts. Contact time and impulse are None if not measured (a miss; the
        impulse also without a significant loss of speed).

    Raises:
        StrikerRefused: the answer was no, or an interlock refused.
        StrikerStopped: somebody stopped the striker after the question was asked, or before it without
            `after_stop`.
        StrikerError: the striker failed.
        RecorderError: a recording is open and its disk has no room for a strike.
        SessionError: another program's session has begun.
    """
    stops = client.call("status")["stops"]
    if not confirm(
        f"The arm will swing at {tip_speed_m_s:.3f} m/s. Are all hands away and the target in place?"
    ):
        raise StrikerRefused("not struck: the answer was no")
    status = client.call("status")
    if status["striker"] != "homed" or status["striker_trouble"]:
        client.call("striker.home", after_stop=after_stop, stops_seen=stops)
    client.call("striker.arm")
    client.call("striker.cock")
    return StrikeOutcome(**client.call("striker.strike", strike_id=name, tip_speed_m_s=tip_speed_m_s))


def outcome_lines(outcome: StrikeOutcome, command_m_s: float) -> list[str]:
    """Lines for the terminal on the outcome of a strike: contact, tip speed, impulse, contacts.

    Args:
        outcome: measurements of the strike; without a contact there is a single line.
        command_m_s: commanded tip speed [m/s].
    """
    if outcome.contact_time_ns is None:
        what = "none measured" if outcome.missed else "not measured by this striker"
        return [f"contact      {what} (commanded {command_m_s:.3f} m/s)"]
    begin_ms, sd_ms = (
        (outcome.contact_time_ns - outcome.released_ns) * 1e-6,
        outcome.contact_time_sd_ns * 1e-6,
    )
    impulse = "none measured"
    if outcome.impulse_n_s is not None:
        impulse = f"{1000 * outcome.impulse_n_s:.2f} ± {1000 * outcome.impulse_sd_n_s:.2f} mN s"
    touches = f"{outcome.contacts}"
    if outcome.contacts > 1:
        touches += ": the arm hit the object again: strike more softly, or leave more room behind the object"
    speed = "not measured"
    if outcome.tip_speed_m_s is not None:
        speed = f"{outcome.tip_speed_m_s:.4f} ± {outcome.tip_speed_sd_m_s:.4f} m/s"
    return [
        f"contact      {begin_ms:.2f} ± {sd_ms:.2f} ms after release, {outcome.contact_time_ns} ns monotonic",
        f"tip speed    {speed} (commanded {command_m_s:.3f})",
        f"impulse      {impulse}",
        f"contacts     {touches}",
    ]


@dataclass(frozen=True)
class CalibrationOrder:
    """Swings of a striker's calibration: tip speeds, repeats, and bodies (free masses, wall) to strike.

    The arm swings in the air first, then at each body.
    """

    speeds_m_s: tuple[float, ...] | None
    """tip speeds to command [m/s]; None for the default_tip_speeds of the rig"""
    repeats: int
    """number of swings at each speed and target"""
    bodies_kg: tuple[float, ...]
    """masses of the free bodies to strike [kg]; infinite for a wall"""


def default_tip_speeds(rig: RigConfig) -> tuple[float, ...]:
    """Tip speeds [m/s] (DEFAULT_SPEED_COUNT,), evenly spaced over a striker's range, slowest first.

    The ends keep a small margin to the slowest and fastest speed that the striker accepts.

    Args:
        rig: rig file; its section [striker] gives the range.
    """
    arm = rig.striker
    slowest = SLOWEST_FACTOR * MIN_ARM_SPEED_RAD_S * arm.arm_length_m
    run_up_rad = arm.cocked_angle_rad / RUN_UP_FACTOR
    fastest = tip_speeds(arm.arm_length_m, run_up_rad, arm.velocity_limit_rad_s).fastest_m_s
    steps = DEFAULT_SPEED_COUNT - 1
    return tuple(round(slowest + (fastest - slowest) * i / steps, SPEED_DECIMALS) for i in range(steps + 1))


def calibrate(
    client: DaemonClient,
    rig: RigConfig,
    order: CalibrationOrder,
    confirm: Confirm,
    on_swing: Callable[[MeasuredSwing], None] = lambda _swing: None,
) -> list[MeasuredSwing]:
    """Home the striker, then swing in the air and at each body, at every speed of the order.

    Args:
        client: client of a daemon that was started with this rig file.
        rig: the rig file.
        order: speeds, repeats and bodies.
        confirm: asks a person before the first swing in the air and before every swing at a body; False
            refuses.
        on_swing: called with every swing after it was made.

    Returns:
        Commanded and reached tip speed, and loss of speed at contact, of each swing, in the order made.

    Raises:
        StrikerRefused: the rig's striker has no encoder, or the answer was no.
        StrikerError: the striker failed or was stopped.
        SessionError: a session is running, or the arm did not complete a swing.
        ConfigError: the daemon runs another rig.
    """
    if not rig.striker.traits.has_servo:
        raise StrikerRefused(
            f"the striker of this rig is {rig.striker.traits.description}: without an encoder it cannot be "
            "calibrated; enter effective_mass_kg and restitution by hand: sessions learn them"
        )
    running = client.call("status")["rig"]
    if running != rig.name:
        raise ConfigError(
            f"the daemon runs rig {running!r}, the file describes {rig.name!r}: "
            "give the file the daemon was started with"
        )
    speeds = order.speeds_m_s or default_tip_speeds(rig)
    swings: list[MeasuredSwing] = []
    with held_striker(client):
        if not confirm("The arm will swing in the air. Is everything out of its way?"):
            raise StrikerRefused("not calibrated: the answer was no")
        client.call("striker.home")
        for body in (None, *order.bodies_kg):
            for speed in (speed for speed in speeds for _ in range(order.repeats)):
                name = f"calibrate-{len(swings) + 1}"
                outcome = _completed_swing(client, name, speed, _confirm_target(body, confirm))
                swings.append(_measured_swing(outcome, speed, body, rig))
                on_swing(swings[-1])
    return swings


def _completed_swing(
    client: DaemonClient, name: str, tip_speed_m_s: float, confirm: Confirm
) -> StrikeOutcome:
    """Swing the arm until one swing reaches angle 0 (the arm hanging down); return its measurements.

    They are the time at angle 0 and the tip speed there, among others. Before each swing `confirm` asks.

    Raises:
        SessionError: none of MAX_SWING_TRIES swings reached angle 0.
    """
    for _ in range(MAX_SWING_TRIES):
        outcome = strike_once(client, name, tip_speed_m_s, confirm, after_stop=False)
        if outcome.contact_time_ns is not None:
            return outcome
    raise SessionError(
        f"{name}: the arm did not reach angle 0 at {tip_speed_m_s:.3f} m/s in {MAX_SWING_TRIES} tries: "
        "check that it moves freely"
    )


def _confirm_target(body_kg: float | None, confirm: Confirm) -> Confirm:
    if body_kg is None:
        return lambda _text: True  # confirmed once, before the first swing in the air
    return lambda text: confirm(f"Place {body_name(body_kg)} at the tip of the hanging arm. {text}")


def body_name(body_kg: float) -> str:
    """Name of a struck body for messages, from its mass [kg]; an infinite mass is a wall."""
    return "a wall" if body_kg == float("inf") else f"the free body of {1000 * body_kg:g} g"


def _measured_swing(
    outcome: StrikeOutcome, command_m_s: float, body_kg: float | None, rig: RigConfig
) -> MeasuredSwing:
    """Commanded and reached tip speed, and loss of speed at contact [m/s], of one swing of a calibration.

    The loss is the measured impulse over the rig file's effective mass; None in the air and if the arm lost
    no significant speed. Its standard deviation leaves out the uncertainty of the effective mass.

    Args:
        outcome: measurements of the swing.
        command_m_s: commanded tip speed [m/s].
        body_kg: mass of the struck free body [kg]; None in the air, infinite for a wall.
        rig: rig file; it gives the effective mass.
    """
    drop, drop_sd = None, 0.0
    if body_kg is not None and outcome.impulse_n_s is not None:
        mass, mass_sd = rig.striker.effective_mass_kg, rig.striker.effective_mass_sd_kg
        drop = outcome.impulse_n_s / mass
        drop_sd = max(outcome.impulse_sd_n_s**2 - (mass_sd * drop) ** 2, 0.0) ** 0.5 / mass
    speed, speed_sd = outcome.tip_speed_m_s or 0.0, outcome.tip_speed_sd_m_s
    return MeasuredSwing(command_m_s, speed, speed_sd, drop, drop_sd, body_kg)


def striker_entries(numbers: StrikerParameters) -> dict[str, str]:
    """Entries of the rig file's section [striker] for the results of a calibration: TOML values by key.

    They are effective mass [kg] and restitution with their standard deviations.
    """
    return {
        "effective_mass_kg": f"{numbers.effective_mass_kg:.4g}",
        "effective_mass_sd_kg": f"{numbers.effective_mass_sd_kg:.2g}",
        "restitution": f"{numbers.restitution:.3g}",
        "restitution_sd": f"{numbers.restitution_sd:.2g}",
    }


def write_striker(path: Path, entries: Mapping[str, str]) -> None:
    """Set entries of the rig file's section [striker]; comments and all other entries stay as they are.

    The file is replaced as a whole, by renaming a new one.

    Args:
        path: the rig file.
        entries: values, as TOML, by key; missing keys are added at the section's end.

    Raises:
        ConfigError: the file cannot be read or written, or has no section written as `[striker]`.
    """
    try:
        text: str | None = read_text(path)
        for key, value in entries.items():
            text = None if text is None else with_entry(text, "striker", key, value)
        if text is None:
            raise ConfigError(f"{path}: no plain section [striker] found: enter these values by hand")
        write_text(path, text)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from None
    except OutputError as error:
        raise ConfigError(str(error)) from None


def air_swings_by_speed(swings: Sequence[MeasuredSwing]) -> list[tuple[float, list[MeasuredSwing]]]:
    """Pairs of commanded tip speed [m/s] and list of swings without an impact at it, slowest first."""
    air = [each for each in swings if each.body_kg is None]
    speeds = sorted({each.command_m_s for each in air})
    return [(speed, [each for each in air if each.command_m_s == speed]) for speed in speeds]
