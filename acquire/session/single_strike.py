"""One strike without a session, and the calibration of a bare striker: a client of the daemon. Every swing is allowed by itself."""

from __future__ import annotations

import contextlib
import os
import re
import tomllib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from acquire.config import RigConfig
from acquire.daemon.api import DaemonClient
from acquire.errors import ConfigError, SessionError, StrikerRefused
from acquire.striker.base import StrikeOutcome
from acquire.striker.calibration import StrikerNumbers, Swing
from schemas.rig_limits import SLOWEST_RAD_S, tip_speeds

Ask = Callable[[str], bool]
"""puts a question to the person at the rig; False: no"""
DEFAULT_STEPS = 5
ABOVE_SLOWEST, LONGER_RUN_UP = 1.2, 1.08
"""margins of a calibration's speeds to what the striker refuses"""
DECIMALS = 4
TRIES = 4
"""of a swing: a host that stands still for 100 ms stops the arm"""


@contextlib.contextmanager
def held_striker(client: DaemonClient) -> Iterator[None]:
    """The block may strike; whatever ends it early stops the arm.

    Raises:
        SessionError: a session is under way: the striker is not ours.
    """
    recording = client.call("status")["recording"]
    if recording:
        raise SessionError(f"a session is under way ({recording}): end it first, the striker is its own")
    try:
        yield
    except BaseException:
        with contextlib.suppress(Exception), client.another() as other:
            other.call("striker.stop")
        raise


def strike_once(client: DaemonClient, name: str, tip_speed_m_s: float, ask: Ask, *, after_stop: bool = True) -> StrikeOutcome:
    """Ask, home where that is needed, arm for one shot, cock, strike.

    Args:
        client: of the daemon.
        name: of the strike.
        tip_speed_m_s: how fast.
        ask: a person, before anything moves.
        after_stop: that person starts anew after somebody stopped the striker; else it stays stopped.

    Raises:
        StrikerRefused: the answer was no, or an interlock said no.
        StrikerStopped: somebody stopped the striker since the question was put.
    """
    stops = client.call("status")["stops"]
    if not ask(f"the arm will swing at {tip_speed_m_s:.3f} m/s: all hands off, what it shall meet in its place?"):
        raise StrikerRefused("not struck: the answer was no")
    status = client.call("status")
    if status["striker"] != "homed" or status["striker_trouble"]:
        client.call("striker.home", after_stop=after_stop, stops_seen=stops)
    client.call("striker.arm")
    client.call("striker.cock")
    return StrikeOutcome(**client.call("striker.strike", strike_id=name, tip_speed_m_s=tip_speed_m_s))


def outcome_lines(outcome: StrikeOutcome, command_m_s: float) -> list[str]:
    """What the striker felt, for people."""
    if outcome.contact_time_ns is None:
        return [f"contact      none felt (commanded {command_m_s:.3f} m/s)"]
    begin_ms = (outcome.contact_time_ns - outcome.released_ns) * 1e-6
    impulse = "no loss of speed stands out"
    if outcome.impulse_n_s is not None:
        impulse = f"{1000 * outcome.impulse_n_s:.2f} ± {1000 * outcome.impulse_sd_n_s:.2f} mN s"
    touches = f"{outcome.contacts}"
    if outcome.contacts > 1:
        touches += ": the arm met it again before it was out of the way: strike softer, or set it farther from what stands behind it"
    return [
        f"contact      {begin_ms:.2f} ± {outcome.contact_time_sd_ns * 1e-6:.2f} ms after release, {outcome.contact_time_ns} ns monotonic",
        f"tip speed    {outcome.tip_speed_m_s:.4f} ± {outcome.tip_speed_sd_m_s:.4f} m/s (commanded {command_m_s:.3f})",
        f"impulse      {impulse}",
        f"contacts     {touches}",
    ]


@dataclass(frozen=True)
class CalibrationOrder:
    """What is to be swung, and at what."""

    speeds_m_s: tuple[float, ...]
    repeats: int
    bodies_kg: tuple[float, ...]
    """free bodies, each struck at every speed after the swings in the air; infinite: a wall"""


def speeds_within(rig: RigConfig, steps: int = DEFAULT_STEPS) -> tuple[float, ...]:
    """Tip speeds [m/s] that this striker can swing, evenly from the slowest to the fastest."""
    arm = rig.striker
    slowest = ABOVE_SLOWEST * SLOWEST_RAD_S * arm.arm_length_m
    fastest = tip_speeds(arm.arm_length_m, arm.cocked_angle_rad / LONGER_RUN_UP, arm.velocity_limit_rad_s).fastest_m_s
    return tuple(round(slowest + (fastest - slowest) * i / (steps - 1), DECIMALS) for i in range(steps))


def calibrate(
    client: DaemonClient, rig: RigConfig, order: CalibrationOrder, ask: Ask, heard: Callable[[Swing], None] = lambda _swing: None
) -> list[Swing]:
    """Swing in the air, then at each body, from slow to fast.

    Args:
        client: of the daemon that runs this very rig file.
        rig: what the daemon reckons with.
        order: what to do.
        ask: asked before the first swing in the air, and before every swing at a body.
        heard: told every swing as it is made.

    Raises:
        StrikerRefused: a hand strikes here; or the answer was no.
        SessionError: a session is under way.
        ConfigError: the daemon runs another rig.
    """
    if rig.striker.kind != "dynamixel":
        raise StrikerRefused("a hand strikes here: there is nothing to calibrate")
    running = client.call("status")["rig"]
    if running != rig.name:
        raise ConfigError(f"the daemon runs rig {running!r}, the file says {rig.name!r}: give the file it was started with")
    swings: list[Swing] = []
    with held_striker(client):
        if not ask("take away all that the arm could meet: it swings in the air now"):
            raise StrikerRefused("not calibrated: the answer was no")
        client.call("striker.home")
        for body in (None, *order.bodies_kg):
            for speed in (speed for speed in order.speeds_m_s for _ in range(order.repeats)):
                outcome = _through(client, f"calibrate-{len(swings) + 1}", speed, _before(body, ask))
                swings.append(_swing(outcome, speed, body, rig))
                heard(swings[-1])
    return swings


def _through(client: DaemonClient, name: str, tip_speed_m_s: float, ask: Ask) -> StrikeOutcome:
    """A swing that came to angle 0, made again where it did not."""
    for _ in range(TRIES):
        outcome = strike_once(client, name, tip_speed_m_s, ask, after_stop=False)
        if outcome.contact_time_ns is not None:
            return outcome
    raise SessionError(f"{name}: the arm did not come to angle 0 at {tip_speed_m_s:.3f} m/s in {TRIES} tries: check that it moves freely")


def _before(body_kg: float | None, ask: Ask) -> Ask:
    if body_kg is None:
        return lambda _text: True  # asked once, before the first
    return lambda text: ask(f"{named(body_kg)} at the hanging arm's tip; {text}")


def named(body_kg: float) -> str:
    """What is struck, in words."""
    return "a wall" if body_kg == float("inf") else f"the body of {1000 * body_kg:g} g, free to move,"


def _swing(outcome: StrikeOutcome, command_m_s: float, body_kg: float | None, rig: RigConfig) -> Swing:
    """The tip's loss of speed from the impulse, which the striker reckons as effective mass times loss."""
    drop, drop_sd = None, 0.0
    if body_kg is not None and outcome.impulse_n_s is not None:
        mass, mass_sd = rig.striker.effective_mass_kg, rig.striker.effective_mass_sd_kg
        drop = outcome.impulse_n_s / mass
        drop_sd = max(outcome.impulse_sd_n_s**2 - (mass_sd * drop) ** 2, 0.0) ** 0.5 / mass
    return Swing(command_m_s, outcome.tip_speed_m_s, outcome.tip_speed_sd_m_s, drop, drop_sd, body_kg)


def striker_lines(numbers: StrikerNumbers) -> dict[str, str]:
    """Entries of the rig file's section [striker]."""
    return {
        "effective_mass_kg": f"{numbers.effective_mass_kg:.4g}",
        "effective_mass_sd_kg": f"{numbers.effective_mass_sd_kg:.2g}",
        "restitution": f"{numbers.restitution:.3g}",
        "restitution_sd": f"{numbers.restitution_sd:.2g}",
    }


def write_striker(path: Path, entries: dict[str, str]) -> None:
    """Put entries into the rig file's section [striker]; every other line stays as it is. Whole or not at all.

    Raises:
        ConfigError: the file cannot be read or written, or its section is not written as `[striker]`.
    """
    try:
        text = path.read_text(encoding="utf-8")
        lines = _with_entries(text.splitlines(), entries)
        if lines is None or not _only_changes(text, "\n".join(lines), entries):
            raise ConfigError(f"{path}: has no plain section [striker] to write in: put these lines there by hand")
        part = path.with_name(path.name + ".part")
        with part.open("w", encoding="utf-8") as file:
            file.write("\n".join(lines) + "\n")
            file.flush()
            os.fsync(file.fileno())
        part.chmod(path.stat().st_mode)
        part.replace(path)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from None


def _with_entries(lines: list[str], entries: dict[str, str]) -> list[str] | None:
    headers = [i for i, line in enumerate(lines) if re.match(r"\s*\[", line)]
    start = next((i for i in headers if re.match(r"\s*\[\s*striker\s*\]\s*(#.*)?$", lines[i])), None)
    if start is None:
        return None
    end = next((i for i in headers if i > start), len(lines))
    section, missing = lines[start + 1 : end], dict(entries)
    for i, line in enumerate(section):
        found = re.match(r"(\s*)(\w+)(\s*=\s*)[^#]*?(\s*#.*)?$", line)
        if found and found[2] in missing:
            section[i] = f"{found[1]}{found[2]}{found[3]}{missing.pop(found[2])}{found[4] or ''}"
    last = next((i for i in range(len(section), 0, -1) if section[i - 1].strip()), 0)
    new = [f"{key} = {value}" for key, value in missing.items()]
    return [*lines[: start + 1], *section[:last], *new, *section[last:], *lines[end:]]


def _only_changes(before: str, after: str, entries: dict[str, str]) -> bool:
    """Whether the file means the same but for these entries: a section can be written in ways that a line editor does not see."""
    old: dict[str, Any]
    try:
        old, new = tomllib.loads(before), tomllib.loads(after)
    except tomllib.TOMLDecodeError:
        return False
    old["striker"] = {**old.get("striker", {}), **{key: float(value) for key, value in entries.items()}}
    return old == new


def reached(swings: Sequence[Swing]) -> list[tuple[float, list[Swing]]]:
    """Swings in the air by commanded speed, slowest first."""
    air = [each for each in swings if each.body_kg is None]
    return [(speed, [each for each in air if each.command_m_s == speed]) for speed in sorted({each.command_m_s for each in air})]
