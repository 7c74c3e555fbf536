"""The terminal side of `acquire strike`: what is asked, and what is printed."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

from acquire.config import read_rig
from acquire.daemon.api import DaemonClient
from acquire.errors import ConfigError, SessionError
from acquire.session import single_strike
from acquire.session.energy import EnergyLearner
from acquire.striker.calibration import StrikerNumbers, Swing, SwingRatio, learn_striker, swing_ratio
from schemas.document import DocumentError
from schemas.strike_plan import read_strike_plan

NOTABLE_RATIO = 0.02
"""difference of reached and commanded tip speed that is worth a word"""


def once(socket: Path, tip_speed_m_s: float, *, yes: bool, as_json: bool) -> bool:
    """One strike; whether the arm felt exactly one contact."""
    with DaemonClient(socket) as client, single_strike.held_striker(client):
        outcome = single_strike.strike_once(client, "single", tip_speed_m_s, _ask(yes))
    lines = single_strike.outcome_lines(outcome, tip_speed_m_s)
    click.echo(json.dumps({"tip_speed_command_m_s": tip_speed_m_s, **asdict(outcome)}) if as_json else "\n".join(lines))
    return outcome.contacts == 1


def planned_speed(plan_path: Path, strike_id: str, energy: float | None) -> float:
    """The speed with which a session would begin this strike, or the one that `energy` is expected of [m/s].

    Raises:
        SessionError: the plan cannot be read, or has no such strike.
    """
    try:
        plan = read_strike_plan(plan_path)
    except DocumentError as error:
        raise SessionError(str(error)) from None
    planned = next((each for each in plan.strikes if each.id == strike_id), None)
    if planned is None:
        raise SessionError(f"{plan_path}: has no strike {strike_id!r}: it has {', '.join(each.id for each in plan.strikes)}")
    learner = EnergyLearner(plan)
    speed = learner.tip_speed(planned) if energy is None else learner.speed_for(planned, energy)
    middle, low, high = learner.energy(planned, speed)
    click.echo(f"{strike_id}: {planned.card}", err=True)
    click.echo(f"{speed:.3f} m/s: energy ratio {middle:.2f}, with 90 % between {low:.2f} and {high:.2f}", err=True)
    return speed


def speeds_of(text: str | None) -> tuple[float, ...] | None:
    """Tip speeds [m/s] from a list; None: the default.

    Raises:
        ConfigError: not numbers above 0.
    """
    if text is None:
        return None
    try:
        speeds = tuple(float(each) for each in text.split(","))
    except ValueError:
        speeds = ()
    if not speeds or not all(0 < speed < 100 for speed in speeds):
        raise ConfigError(f"--speeds {text}: give tip speeds in m/s, as 0.15,0.3,0.5")
    return speeds


def calibrate(
    rig_path: Path, speeds: tuple[float, ...] | None, bodies: tuple[float, ...], repeats: int, *, write: bool, yes: bool, as_json: bool
) -> None:
    """Swing, learn, print, write."""
    rig = read_rig(rig_path)
    order = single_strike.CalibrationOrder(speeds or single_strike.speeds_within(rig), repeats, bodies)
    arm = rig.striker
    prior = StrikerNumbers(arm.effective_mass_kg, arm.effective_mass_sd_kg, arm.restitution, arm.restitution_sd)
    with DaemonClient(rig.daemon.socket_path()) as client:
        swings = single_strike.calibrate(client, rig, order, _ask(yes), _tell)
    ratio, learned = swing_ratio([each for each in swings if each.body_kg is None]), learn_striker(prior, swings)
    entries = single_strike.striker_lines(learned)
    if as_json:
        found = {"swings": [_plain(each) for each in swings], "swing_ratio": asdict(ratio), "striker": asdict(learned)}
        click.echo(json.dumps(found))
    else:
        _print(swings, ratio)
        _print_learned(swings, prior, learned, entries)
    if write and learned is not prior:
        single_strike.write_striker(rig_path, entries)
        click.echo(f"written to {rig_path}: start the daemon anew, and plan anew", err=True)
    elif write:
        click.echo(f"{rig_path} stays as it is: swings in the air tell nothing of mass and restitution", err=True)


def _ask(yes: bool) -> single_strike.Ask:
    return (lambda _text: True) if yes else lambda text: click.confirm(text, err=True)


def _tell(swing: Swing) -> None:
    met = "in the air" if swing.body_kg is None else single_strike.named(swing.body_kg)
    click.echo(f"{swing.command_m_s:.3f} m/s {met}: reached {swing.speed_m_s:.4f} ± {swing.speed_sd_m_s:.4f}", err=True)


def _plain(swing: Swing) -> dict[str, float | str | None]:
    """JSON has no infinity."""
    return asdict(swing) | ({"body_kg": "wall"} if swing.body_kg == float("inf") else {})


def _print(swings: list[Swing], ratio: SwingRatio) -> None:
    table = Table(title="tip speed in the air", title_justify="left")
    for heading in ("commanded [m/s]", "reached [m/s]", "ratio", "swings"):
        table.add_column(heading, justify="right")
    for command, some in single_strike.reached(swings):
        each = swing_ratio(some)
        table.add_row(f"{command:.3f}", f"{each.mean * command:.4f} ± {each.mean_sd * command:.4f}", f"{each.mean:.4f}", str(len(some)))
    Console().print(table)
    click.echo(f"reached / commanded {ratio.mean:.4f} ± {ratio.mean_sd:.4f}, from swing to swing ± {ratio.scatter:.4f}")
    if abs(ratio.mean - 1) > NOTABLE_RATIO:
        click.echo("that is far from 1: more current_limit_a, a larger cocked_angle_rad, or less speed; sessions learn it all the same")


def _print_learned(swings: list[Swing], prior: StrikerNumbers, learned: StrikerNumbers, entries: dict[str, str]) -> None:
    if learned is prior:
        click.echo(
            "effective mass and restitution: not learned; strike a light and a heavy free body: --body-mass-kg 0.03 --body-mass-kg 1"
        )
        return
    if len({each.body_kg for each in swings if each.body_kg is not None}) == 1:
        click.echo("one body tells effective mass and restitution together, not apart; strike another that is ten times heavier or lighter")
    click.echo("[striker]\n" + "\n".join(f"{key} = {value}" for key, value in entries.items()))
