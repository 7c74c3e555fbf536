"""Terminal interface of `acquire strike`: questions, tables, JSON; its options are in acquire/cli.py."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import click
from rich.table import Table

from acquire.config import read_rig
from acquire.daemon.client import DaemonClient
from acquire.errors import ConfigError, SessionError
from acquire.session import single_strike
from acquire.session.energy import EnergyLearner
from acquire.striker.calibration import (
    MeasuredSwing,
    StrikerParameters,
    SwingRatio,
    estimate_striker,
    swing_ratio,
)
from schemas.document import DocumentError
from schemas.plain_text import echo
from schemas.strike_plan import read_strike_plan
from schemas.terminal import Terminal

NOTABLE_RATIO_ERROR = 0.02
"""relative difference of reached and commanded tip speed above which advice is printed"""


def strike_once(socket: Path, tip_speed_m_s: float, *, yes: bool, as_json: bool) -> bool:
    """Strike once and print the outcome (contact time, tip speed, impulse, number of contacts).

    Args:
        socket: path of the daemon's socket.
        tip_speed_m_s: tip speed to command [m/s].
        yes: True to strike without asking.
        as_json: True to print the outcome as JSON.

    Returns:
        True unless the striker found that it met nothing, or touched the object more than once.

    Raises:
        AcquireError: the daemon cannot be reached, a session is running, the answer was no, or the striker
            failed.
    """
    with DaemonClient(socket) as client, single_strike.held_striker(client):
        outcome = single_strike.strike_once(client, "single", tip_speed_m_s, _confirm(yes))
    lines = single_strike.outcome_lines(outcome, tip_speed_m_s)
    echo(
        json.dumps({"tip_speed_command_m_s": tip_speed_m_s, **asdict(outcome)})
        if as_json
        else "\n".join(lines)
    )
    return outcome.contacts <= 1 and not outcome.missed


def planned_speed(plan_path: Path, strike_id: str, energy: float | None) -> float:
    """Tip speed [m/s] for a planned strike; prints the strike's card (instruction) and energy ratio.

    The energy ratio, printed with its 90 % interval, is the kinetic energy after the strike over the energy
    needed to reach balance. The text goes to standard error.

    Args:
        plan_path: plan file.
        strike_id: id of the strike in the plan.
        energy: median energy ratio that the speed is to give; None for the speed that a session would begin
            with.

    Raises:
        SessionError: the plan cannot be read, or has no strike with this id.
    """
    try:
        plan = read_strike_plan(plan_path)
    except DocumentError as error:
        raise SessionError(str(error)) from None
    planned = next((each for each in plan.strikes if each.id == strike_id), None)
    if planned is None:
        known = ", ".join(each.id for each in plan.strikes)
        raise SessionError(f"{plan_path}: no strike {strike_id!r}: choose one of {known}")
    learner = EnergyLearner(plan)
    speed = learner.tip_speed(planned) if energy is None else learner.speed_for(planned, energy)
    middle, low, high = learner.energy(planned, speed)
    echo(f"{strike_id}: {planned.card}", err=True)
    echo(
        f"{speed:.3f} m/s: expected energy ratio {middle:.2f}, 90 % interval {low:.2f} to {high:.2f}",
        err=True,
    )
    return speed


def parse_speeds(text: str | None) -> tuple[float, ...] | None:
    """Tip speeds [m/s] from a comma-separated list; None if no list was given.

    Raises:
        ConfigError: an entry is not a number between 0 and 100, both excluded.
    """
    if text is None:
        return None
    try:
        speeds = tuple(float(each) for each in text.split(","))
    except ValueError:
        speeds = ()
    if not speeds or not all(0 < speed < 100 for speed in speeds):
        raise ConfigError(
            f"--speeds {text}: give tip speeds in m/s between 0 and 100, for example 0.15,0.3,0.5"
        )
    return speeds


def calibrate(
    rig_path: Path, order: single_strike.CalibrationOrder, *, write: bool, yes: bool, as_json: bool
) -> None:
    """Calibrate a bare striker: swing, estimate effective mass and restitution, print them.

    The ratio of reached to commanded tip speed is printed as well.

    Args:
        rig_path: the rig file; with `write` its section [striker] gets the estimates.
        order: tip speeds, repeats and bodies (free masses or a wall) of the swings.
        write: True to write the estimates, unless the swings determine none (such as swings in the air
            alone).
        yes: True to swing without asking.
        as_json: True to print swings and estimates as JSON.

    Raises:
        AcquireError: the rig file cannot be used, the daemon cannot be reached, the answer was no,
            or the striker failed.
    """
    rig = read_rig(rig_path)
    arm = rig.striker
    prior = StrikerParameters(
        arm.effective_mass_kg, arm.effective_mass_sd_kg, arm.restitution, arm.restitution_sd
    )
    with DaemonClient(rig.daemon.socket_path()) as client:
        swings = single_strike.calibrate(client, rig, order, _confirm(yes), _print_swing)
    ratio = swing_ratio([each for each in swings if each.body_kg is None])
    learned = estimate_striker(prior, swings)
    entries = single_strike.striker_entries(learned)
    if as_json:
        swing_dicts = [_json_swing(each) for each in swings]
        echo(json.dumps({"swings": swing_dicts, "swing_ratio": asdict(ratio), "striker": asdict(learned)}))
    else:
        _print_swing_ratio(swings, ratio)
        _print_striker(swings, prior, learned, entries)
    if write and learned is not prior:
        single_strike.write_striker(rig_path, entries)
        echo(f"written to {rig_path}: restart the daemon and plan again", err=True)
    elif write:
        echo(
            f"{rig_path} is unchanged: swings in the air do not determine effective mass and restitution",
            err=True,
        )


def _confirm(yes: bool) -> single_strike.Confirm:
    return (lambda _text: True) if yes else lambda text: click.confirm(text, err=True)


def _print_swing(swing: MeasuredSwing) -> None:
    target = "in the air" if swing.body_kg is None else f"at {single_strike.body_name(swing.body_kg)}"
    reached = f"reached {swing.speed_m_s:.4f} ± {swing.speed_sd_m_s:.4f} m/s"
    echo(f"{swing.command_m_s:.3f} m/s {target}: {reached}", err=True)


def _json_swing(swing: MeasuredSwing) -> dict[str, float | str | None]:
    """JSON object of a calibration swing; a wall's infinite mass becomes "wall": JSON has no infinity."""
    return asdict(swing) | ({"body_kg": "wall"} if swing.body_kg == float("inf") else {})


def _print_swing_ratio(swings: list[MeasuredSwing], ratio: SwingRatio) -> None:
    table = Table(title="tip speed in the air", title_justify="left")
    for heading in ("commanded [m/s]", "reached [m/s]", "ratio", "swings"):
        table.add_column(heading, justify="right")
    for command, at_speed in single_strike.air_swings_by_speed(swings):
        each = swing_ratio(at_speed)
        reached = f"{each.mean * command:.4f} ± {each.mean_sd * command:.4f}"
        table.add_row(f"{command:.3f}", reached, f"{each.mean:.4f}", str(len(at_speed)))
    Terminal().print(table)
    echo(
        f"reached / commanded speed: {ratio.mean:.4f} ± {ratio.mean_sd:.4f}, "
        f"scatter between swings {ratio.scatter:.4f}"
    )
    if abs(ratio.mean - 1) > NOTABLE_RATIO_ERROR:
        echo(
            "this ratio is far from 1: raise current_limit_a, enlarge cocked_angle_rad, "
            "or strike more slowly (a session corrects for it in any case)"
        )


def _print_striker(
    swings: list[MeasuredSwing], prior: StrikerParameters, learned: StrikerParameters, entries: dict[str, str]
) -> None:
    if learned is prior:
        echo(
            "effective mass and restitution were not determined: strike a light and a heavy free body, "
            "for example --body-mass-kg 0.03 --body-mass-kg 1"
        )
        return
    if len({each.body_kg for each in swings if each.body_kg is not None}) == 1:
        echo(
            "one body determines only a combination of effective mass and restitution: "
            "strike a second one that is ten times heavier or lighter"
        )
    echo("[striker]\n" + "\n".join(f"{key} = {value}" for key, value in entries.items()))
