"""The `acquire` command: verbs only; each hands over to the module that does the work.

Exit codes: 0 done, 1 a named problem (one line on standard error), 2 wrong usage, 3 ended early or with loss, 130 interrupted.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

import click

from acquire.errors import AcquireError, CameraNotFound, DaemonSilent
from schemas.command_line import Commands, NumberRange, one_line_errors

_one_line_errors = one_line_errors("acquire", AcquireError)


@click.group("acquire", cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="percuss")
def main() -> None:
    """Drive the rig: strike, film, record."""


@main.command()
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@_one_line_errors
def discover(as_json: bool) -> None:
    """List the GigE Vision cameras that answer. Exits with 1 when none does."""
    from acquire.camera.aravis_library import discover as discover_cameras

    cameras = discover_cameras()
    if as_json:
        click.echo(json.dumps([vars(camera) for camera in cameras]))
    for camera in [] if as_json else cameras:
        click.echo(f"{camera.address:16} {camera.vendor} {camera.model} ({camera.serial})")
    if not cameras:
        raise CameraNotFound(
            "no camera answers: check power and cable, that host and camera are in one subnet (`ip address`), "
            "and that no firewall drops UDP port 3956"
        )


@main.command()
@click.argument("rig", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@_one_line_errors
def check(rig: Path, as_json: bool) -> None:
    """Check all that can be wrong before a session with RIG. Exits with 1 when anything fails."""
    from rich.console import Console

    from acquire.preflight.check import Outcome
    from acquire.preflight.picture import CheckPicture
    from acquire.preflight.session import check_rig, real_probes

    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)  # as Ctrl-C: what was started ends, what was written goes
    console = Console(highlight=False)
    picture = CheckPicture(console) if console.is_terminal and not as_json else None
    checks, began = [], time.monotonic()
    for line in check_rig(rig, real_probes()):
        checks.append(line)
        if picture is not None:
            picture.show(line)
        elif not as_json:
            click.echo(line.text())
    if picture is not None:
        picture.verdict(time.monotonic() - began)
    good = all(line.outcome is not Outcome.FAIL for line in checks)
    if as_json:
        click.echo(json.dumps({"passed": good, "checks": [line.as_dict() for line in checks]}))
    if not good:
        sys.exit(1)


@main.command()
@click.argument("rig", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print the status as one JSON line when ready.")
@click.option("--parent", type=int, hidden=True, help="End when the process with this id, which started this one, has ended.")
@_one_line_errors
def run(rig: Path, as_json: bool, parent: int | None) -> None:
    """Run the daemon for RIG (a rig file, TOML) until stopped."""
    from acquire.config import read_rig
    from acquire.daemon.daemon import Daemon

    config = read_rig(rig)

    def ready(status: dict[str, Any]) -> None:
        model, address = status["camera"]["model"], config.camera.address
        click.echo(json.dumps(status) if as_json else f"ready: {model} at {address}, socket {status['socket']}")
        sys.stdout.flush()

    goes_on = (lambda: True) if parent is None else (lambda: os.getppid() == parent)
    Daemon(config, rig.read_text(encoding="utf-8")).run(ready, goes_on)


@main.command()
@click.argument("object_file", metavar="OBJECT", type=click.Path(path_type=Path))
@click.argument("plan", type=click.Path(path_type=Path))
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="The recording to write (.mcap).")
@click.option("--rig", type=click.Path(path_type=Path), help="Rig file that names the daemon's socket; default socket without it.")
@click.option("--json", "as_json", is_flag=True, help="Print the report as JSON.")
@_one_line_errors
def session(object_file: Path, plan: Path, output: Path, rig: Path | None, as_json: bool) -> None:
    """Strike OBJECT (TOML) by PLAN (JSON) with the running daemon; asks you to place it."""
    from acquire.console.session import ConsoleOperator, SessionProgress
    from acquire.daemon.api import DaemonClient
    from acquire.recorder.atomic import refuse_unwritable
    from acquire.session.runner import SessionInput, SessionRunner

    refuse_unwritable(output)
    given = SessionInput(object_file, plan)
    socket = _socket(rig)
    with DaemonClient(socket) as client, SessionProgress() as progress, ConsoleOperator(socket, progress):
        report = SessionRunner(client, given, output, progress).run()
    _print_session(report, as_json)


@main.command()
@click.option(
    "--object",
    "object_name",
    default="carton",
    show_default=True,
    type=click.Choice(["carton", "spray", "juice", "salt", "parcel"]),
    help="What to strike; the parcel holds lumps, no even parts.",
)
@click.option("--seed", default=1, type=click.IntRange(0), help="Seed of everything random in the virtual rig.")
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="The recording to write (.mcap).")
@click.option("--address", default="127.0.0.1", help="Loopback address of the virtual camera; one per rig.")
@click.option("--strikes", default=9, type=click.IntRange(3), help="Strikes to plan.")
@click.option("--axes", type=click.IntRange(1), help="Strike at most so many axes.  [default: as many as pay]")
@click.option("--method", type=click.Choice(["ours", "paper"]), default="ours", help="How the strikes are chosen; see `analyze plan`.")
@click.option("--force", is_flag=True, help="Replace the output if it exists.")
@click.option("--json", "as_json", is_flag=True, help="Print the report as JSON.")
@_one_line_errors
def demo(
    object_name: str, seed: int, output: Path, address: str, strikes: int, axes: int | None, method: str, force: bool, as_json: bool
) -> None:
    """Run a whole session on the virtual rig: real GigE Vision, real Dynamixel protocol, no hardware."""
    from acquire.console.session import SessionProgress
    from acquire.demo import DemoPlan, fresh_output, replaced_output, run_demo

    place = replaced_output(output) if force else fresh_output(output)
    with SessionProgress() as progress:
        report = run_demo(object_name, seed, place, address=address, plan=DemoPlan(strikes, axes, method), progress=progress)
    _print_session(report, as_json)


@main.command()
@click.option("--rig", type=click.Path(path_type=Path), help="Rig file that names the daemon's socket; --calibrate needs it.")
@click.option("--speed", type=NumberRange(0, 100, min_open=True), help="Tip speed, m/s.")
@click.option("--plan", type=click.Path(path_type=Path), help="Take the speed from this plan, for --strike.")
@click.option("--strike", "strike_id", help="Which strike of the plan.")
@click.option("--energy", type=NumberRange(0.1, 3.0), help="Energy ratio wanted of the plan's strike; default: as a session would begin.")
@click.option("--calibrate", is_flag=True, help="Swing a bare striker at several speeds, then at the bodies given.")
@click.option("--body-mass-kg", "bodies", type=NumberRange(0, min_open=True), multiple=True, help="A free body to strike; inf: a wall.")
@click.option("--speeds", help="With --calibrate: tip speeds in m/s, comma-separated; default: five, all that it can.")
@click.option("--repeats", default=2, show_default=True, type=click.IntRange(1, 20), help="With --calibrate: swings at each speed.")
@click.option("--write", is_flag=True, help="With --calibrate: put what was learned into the rig file.")
@click.option("--yes", is_flag=True, help="Do not ask before a swing.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@_one_line_errors
def strike(
    rig: Path | None,
    speed: float | None,
    plan: Path | None,
    strike_id: str | None,
    energy: float | None,
    calibrate: bool,
    bodies: tuple[float, ...],
    speeds: str | None,
    repeats: int,
    write: bool,
    yes: bool,
    as_json: bool,
) -> None:
    """Strike once without a session, or --calibrate a bare striker. Asks before every strike."""
    from acquire.console import strike as strike_command

    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)  # as Ctrl-C: the arm is stopped
    if calibrate:
        if rig is None or speed is not None or plan is not None:
            raise click.UsageError("--calibrate needs --rig, and takes --speeds in place of --speed and --plan")
        strike_command.calibrate(rig, strike_command.speeds_of(speeds), bodies, repeats, write=write, yes=yes, as_json=as_json)
        return
    if bodies or speeds or write or (speed is None) == (plan is None) or (plan is None) != (strike_id is None):
        raise click.UsageError("give --speed, or --plan with --strike; --body-mass-kg, --speeds and --write belong to --calibrate")
    if plan is not None and strike_id is not None:
        speed = strike_command.planned_speed(plan, strike_id, energy)
    elif energy is not None:
        raise click.UsageError("--energy needs --plan and --strike: without an object a speed has no energy ratio")
    if not strike_command.once(_socket(rig), speed or 0.0, yes=yes, as_json=as_json):
        sys.exit(3)


@main.command()
@click.option("--rig", type=click.Path(path_type=Path), help="Rig file that names the daemon's socket.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@_one_line_errors
def status(rig: Path | None, as_json: bool) -> None:
    """Show what the daemon is doing."""
    from acquire.daemon.api import DaemonClient

    with DaemonClient(_socket(rig)) as client:
        answer = client.call("status")
    if as_json:
        click.echo(json.dumps(answer))
        return
    for key, value in answer.items():
        click.echo(f"{key:22} {value}")


@main.command()
@click.option("--rig", type=click.Path(path_type=Path), help="Rig file that names the daemon's socket.")
@click.option("--daemon", "whole", is_flag=True, help="End the daemon too, not only the motion.")
@_one_line_errors
def stop(rig: Path | None, whole: bool) -> None:
    """Stop the striker now."""
    from acquire.daemon.api import DaemonClient

    try:
        with DaemonClient(_socket(rig), patience_s=2.0) as client:
            client.call("striker.stop")
            if whole:
                client.call("shutdown")
    except DaemonSilent as error:
        raise DaemonSilent(f"NOT STOPPED: if the arm moves, cut the motor's power: {error}") from None
    click.echo("daemon stopped" if whole else "striker stopped")


@main.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Where to write; default FILE with -recovered before .mcap.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@_one_line_errors
def recover(file: Path, output: Path | None, as_json: bool) -> None:
    """Rebuild a recording that was cut short. Exits with 3 when anything was lost, be it only what came behind a cut."""
    from acquire.recorder.recover.recover import default_output
    from acquire.recorder.recover.recover import recover as recover_file

    report = recover_file(file, output or default_output(file))
    click.echo(json.dumps(report.as_dict()) if as_json else report.text())
    if report.anything_lost:
        sys.exit(3)


def _socket(rig: Path | None) -> Path:
    from acquire.config import DaemonConfig, read_rig

    return read_rig(rig).daemon.socket_path() if rig is not None else DaemonConfig().socket_path()


def _print_session(report: Any, as_json: bool) -> None:
    if as_json:
        numbers = {"strikes": report.strikes, "frames": report.frames, "lost": report.lost}
        click.echo(json.dumps({"path": str(report.path), "files": [str(path) for path in report.files], **numbers}))
    else:
        click.echo(f"{', '.join(map(str, report.files))}: {report.strikes} strikes, {report.frames} frames, {report.lost} lost")
    if report.aborted:
        click.echo(f"acquire: the session ended early: {report.text}", err=True)
    if report.aborted or report.lost:
        sys.exit(3)
