"""The `acquire` command line: one function per verb; each calls the module that does the work.

Exit codes: 0 done, 1 a named problem (one line on standard error), 2 wrong usage, 3 ended early or with loss,
130 interrupted.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

import click

from acquire.console.session_options import target_of, target_options
from acquire.console.strike_options import StrikeOptions
from acquire.console.virtual_options import virtual_options
from acquire.console.web_verb import console
from acquire.errors import AcquireError, DaemonSilent
from schemas.command_line import Commands, NumberRange, one_line_errors, version_option
from schemas.input_file import read_text
from schemas.plain_text import echo
from schemas.wording import counted

_one_line_errors = one_line_errors("acquire", AcquireError)
_SOCKET_HELP = "Rig file that names the daemon's socket"


@click.group("acquire", cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@version_option("acquire")
def main() -> None:
    """Drive the rig: strike the object, film it, record everything."""


main.add_command(console)


@main.command()
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option("--servo", is_flag=True, help="Search the serial ports for servos.")
@click.option("--port", "ports", multiple=True, help="Search this serial port only, for servos.")
@_one_line_errors
def discover(as_json: bool, servo: bool, ports: tuple[str, ...]) -> None:
    """List the GigE Vision cameras that answer, or the servos. Exits with 1 if none does."""
    from acquire.console.discover import list_cameras, list_servos

    list_servos(list(ports), as_json=as_json) if servo or ports else list_cameras(as_json=as_json)


@main.command()
@click.argument("rig", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option("--json-lines", "as_lines", is_flag=True, help="Print each check as a JSON line when it ends.")
@_one_line_errors
def check(rig: Path, as_json: bool, as_lines: bool) -> None:
    """Check camera, striker, computer and disk before a session with RIG. Exits with 1 if a check fails."""
    from acquire.preflight.check import Outcome
    from acquire.preflight.picture import CheckPicture
    from acquire.preflight.session import check_rig, real_probes
    from schemas.terminal import Terminal

    _end_as_on_ctrl_c()  # the processes it started end, its temporary files are removed
    console = Terminal()
    picture = CheckPicture(console) if console.is_terminal and not (as_json or as_lines) else None
    checks, began = [], time.monotonic()
    for line in check_rig(rig, real_probes()):
        checks.append(line)
        if picture is not None:
            picture.show(line)
        elif as_lines:
            echo(json.dumps(line.as_dict()))
            sys.stdout.flush()
        elif not as_json:
            echo(line.text())
    if picture is not None:
        picture.verdict(time.monotonic() - began)
    good = all(line.outcome is not Outcome.FAIL for line in checks)
    if as_json:
        echo(json.dumps({"passed": good, "checks": [line.as_dict() for line in checks]}))
    if as_lines:
        echo(json.dumps({"passed": good}))
    if not good:
        sys.exit(1)


@main.command()
@click.argument("rig", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print the status as one JSON line when ready.")
@click.option("--parent", type=int, hidden=True, help="Process id of the parent: end when it has ended.")
@_one_line_errors
def run(rig: Path, as_json: bool, parent: int | None) -> None:
    """Run the daemon for RIG (a rig file, TOML) until it is stopped."""
    from acquire.config import read_rig
    from acquire.daemon.daemon import Daemon

    config = read_rig(rig)

    def ready(status: dict[str, Any]) -> None:
        model, address = status["camera"]["model"], config.camera.address
        echo(json.dumps(status) if as_json else f"ready: {model} at {address}, socket {status['socket']}")
        sys.stdout.flush()

    parent_alive = (lambda: True) if parent is None else (lambda: os.getppid() == parent)
    Daemon(config, read_text(rig)).run(ready, parent_alive)


@main.command()
@click.argument("object_file", metavar="OBJECT", type=click.Path(path_type=Path))
@click.argument("plan", type=click.Path(path_type=Path))
@click.option(
    "-o", "--output", required=True, type=click.Path(path_type=Path), help="The recording to write (.mcap)."
)
@click.option(
    "--rig", type=click.Path(path_type=Path), help=f"{_SOCKET_HELP}; without it, the default socket."
)
@target_options
@click.option(
    "--resume",
    "earlier",
    multiple=True,
    type=click.Path(path_type=Path),
    help="Go on where this recording of the same plan ended; may be given for several.",
)
@click.option(
    "--prompts",
    type=click.Choice(["terminal", "others"]),
    default="terminal",
    show_default=True,
    help="Who answers the prompts: this terminal, or other clients of the daemon (a console).",
)
@click.option("--tosses-only", "only_tosses", is_flag=True, help="Make the plan's tosses, and no strike.")
@click.option("--note", default="", help="Remark to write into the recording.")
@click.option(
    "--countdown",
    "countdown_s",
    default=0.0,
    type=NumberRange(0, 60),
    help="Wait this many seconds before every arming.  [default: none]",
)
@click.option("--json", "as_json", is_flag=True, help="Print the report as JSON.")
@_one_line_errors
def session(
    object_file: Path, plan: Path, output: Path, rig: Path | None, as_json: bool, **options: Any
) -> None:
    """Strike OBJECT (TOML) by PLAN (JSON) with the running daemon. Asks you to place the object.

    With --until every strike is chosen by the answer so far, and the session ends when it is certain enough.
    """
    from acquire.console.session import ConsoleOperator, SessionProgress
    from acquire.daemon.client import DaemonClient
    from acquire.recorder.atomic import refuse_taken, refuse_unwritable
    from acquire.session.earlier import read_earlier
    from acquire.session.options import SessionOptions
    from acquire.session.runner import SessionRunner
    from acquire.session.session_input import SessionInput

    refuse_unwritable(output)
    refuse_taken(output)
    target = target_of(options["until"], options["max_strikes"])
    given = SessionInput(object_file, plan)
    before = read_earlier(options["earlier"], given.plan_json, plan)
    socket = _socket(rig)
    with contextlib.ExitStack() as cleanup:
        client = cleanup.enter_context(DaemonClient(socket))
        progress = cleanup.enter_context(SessionProgress())
        if options["prompts"] == "terminal":
            cleanup.enter_context(ConsoleOperator(socket, progress))
        how = SessionOptions(
            target, before, options["note"], options["countdown_s"], only_tosses=options["only_tosses"]
        )
        report = SessionRunner(client, given, output, progress, how).run()
    _print_session(report, as_json)


@main.command()
@virtual_options
@click.option(
    "-o", "--output", required=True, type=click.Path(path_type=Path), help="The recording to write (.mcap)."
)
@click.option("--strikes", default=9, type=click.IntRange(0), help="Number of strikes; 0 with --tosses.")
@click.option(
    "--axes", type=click.IntRange(1), help="Largest number of pivot axes.  [default: as many as pay]"
)
@click.option(
    "--method",
    type=click.Choice(["ours", "paper"]),
    default="ours",
    help="How the strikes are chosen; see `analyze plan`.",
)
@click.option("--tosses", default=0, type=click.IntRange(0, 20), help="Number of tosses after the strikes.")
@target_options
@click.option("--force", is_flag=True, help="Replace the output if it exists.")
@click.option("--json", "as_json", is_flag=True, help="Print the report as JSON.")
@_one_line_errors
def demo(output: Path, force: bool, as_json: bool, **options: Any) -> None:
    """Run a whole session on the virtual rig: real GigE Vision, real Dynamixel protocol, no hardware."""
    from acquire.chosen_devices import device_options
    from acquire.console.session import SessionProgress
    from acquire.demo import DemoPlan, fresh_output, replaced_output, run_demo

    devices = device_options(options)
    place = replaced_output(output) if force else fresh_output(output)
    if options["strikes"] < 3 and not options["tosses"]:
        raise click.UsageError(f"--strikes {options['strikes']}: ask for 3, or for tosses (--tosses 3)")
    target = target_of(options.pop("until"), options.pop("max_strikes"))
    plan = DemoPlan(**options, target=target)
    with SessionProgress() as progress:
        report = run_demo(devices, place, plan=plan, progress=progress)
    _print_session(report, as_json)


@main.command()
@virtual_options
@click.option(
    "--dir",
    "folder",
    default=Path("virtual-rig"),
    show_default=True,
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for the rig file.",
)
@_one_line_errors
def virtual(folder: Path, **options: Any) -> None:
    """Run a virtual camera and striker, to rehearse `check`, `run`, `session` and `stop` without hardware.

    Prints the commands to use and ends on Ctrl-C.
    """
    from acquire.chosen_devices import device_options
    from acquire.virtual.rehearsal import rehearse

    def show(line: str) -> None:
        echo(line)
        sys.stdout.flush()

    rehearse(device_options(options), folder, show)


@main.command()
@click.option("--rig", type=click.Path(path_type=Path), help=f"{_SOCKET_HELP}; required for --calibrate.")
@click.option("--speed", type=NumberRange(0, 100, min_open=True), help="Tip speed [m/s].")
@click.option("--plan", type=click.Path(path_type=Path), help="Plan to take the speed from; needs --strike.")
@click.option("--strike", "strike_id", help="Id of the strike in the plan.")
@click.option(
    "--energy",
    type=NumberRange(0.1, 3.0),
    help="Energy ratio of the planned strike; 1 just tips the object.  [default: as a session would begin]",
)
@click.option(
    "--calibrate", is_flag=True, help="Swing the bare striker at several speeds, then at the bodies given."
)
@click.option(
    "--body-mass-kg",
    "bodies",
    type=NumberRange(0, min_open=True),
    multiple=True,
    help="With --calibrate: mass of a free body to strike [kg]; inf for a wall. May be repeated.",
)
@click.option(
    "--speeds",
    help="With --calibrate: tip speeds [m/s], comma-separated.  [default: five over the striker's range]",
)
@click.option(
    "--repeats",
    default=2,
    show_default=True,
    type=click.IntRange(1, 20),
    help="With --calibrate: swings at each speed.",
)
@click.option("--write", is_flag=True, help="With --calibrate: write the estimates into the rig file.")
@click.option("--yes", is_flag=True, help="Do not ask before a swing.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@_one_line_errors
def strike(rig: Path | None, yes: bool, as_json: bool, **strike_options: Any) -> None:
    """Strike once without a session, or --calibrate a bare striker. Asks before every strike."""
    from acquire.console import strike as strike_command
    from acquire.session.single_strike import CalibrationOrder

    _end_as_on_ctrl_c()  # the arm is stopped
    given = StrikeOptions(**strike_options)
    given.refuse_contradictions(rig)
    if given.calibrate and rig is not None:
        order = CalibrationOrder(strike_command.parse_speeds(given.speeds), given.repeats, given.bodies)
        strike_command.calibrate(rig, order, write=given.write, yes=yes, as_json=as_json)
        return
    speed = given.speed or 0.0
    if given.plan is not None and given.strike_id is not None:
        speed = strike_command.planned_speed(given.plan, given.strike_id, given.energy)
    if not strike_command.strike_once(_socket(rig), speed, yes=yes, as_json=as_json):
        sys.exit(3)


@main.command()
@click.option("--rig", type=click.Path(path_type=Path), help=f"{_SOCKET_HELP}.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@_one_line_errors
def status(rig: Path | None, as_json: bool) -> None:
    """Show the state of daemon, camera, striker and recording."""
    from acquire.daemon.client import DaemonClient

    with DaemonClient(_socket(rig)) as client:
        answer = client.call("status")
    if as_json:
        echo(json.dumps(answer))
        return
    for key, value in answer.items():
        echo(f"{key:22} {value}")


@main.command()
@click.option("--rig", type=click.Path(path_type=Path), help=f"{_SOCKET_HELP}.")
@click.option("--daemon", "end_daemon", is_flag=True, help="End the daemon as well.")
@_one_line_errors
def stop(rig: Path | None, end_daemon: bool) -> None:
    """Stop the striker now. With --daemon, end the daemon as well."""
    from acquire.daemon.client import DaemonClient

    try:
        with DaemonClient(_socket(rig), patience_s=2.0) as client:
            client.call("striker.stop")
            if end_daemon:
                with client.another() as again:  # where many are connected, each connection has one request
                    again.call("shutdown")
    except DaemonSilent as error:
        raise DaemonSilent(f"NOT STOPPED: if the arm moves, cut the motor's power: {error}") from None
    echo("daemon stopped" if end_daemon else "striker stopped")


@main.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help="The file to write.  [default: FILE with -recovered before .mcap]",
)
@click.option("--force", is_flag=True, help="Replace the output if it exists.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@_one_line_errors
def recover(file: Path, output: Path | None, force: bool, as_json: bool) -> None:
    """Rebuild a recording that was cut short. Exits with 3 if anything is missing, changed or unverified."""
    from acquire.recorder.recover.recover import default_output
    from acquire.recorder.recover.recover import recover as recover_file

    report = recover_file(file, output or default_output(file), replace=force)
    echo(json.dumps(report.as_dict()) if as_json else report.text())
    if report.anything_lost:
        sys.exit(3)


def _end_as_on_ctrl_c() -> None:
    """Let SIGTERM and SIGHUP raise KeyboardInterrupt, so that the program cleans up as on Ctrl-C."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)


def _socket(rig: Path | None) -> Path:
    from acquire.config import read_rig
    from schemas.daemon_config import DaemonConfig

    return read_rig(rig).daemon.socket_path() if rig is not None else DaemonConfig().socket_path()


def _print_session(report: Any, as_json: bool) -> None:
    if as_json:
        numbers = {"strikes": report.strikes, "frames": report.frames, "lost": report.lost}
        files = {"path": str(report.path), "files": [str(path) for path in report.files]}
        echo(json.dumps({**files, **numbers, "skipped": list(report.skipped)}))
    else:
        counts = (
            f"{counted(report.strikes, 'strike')}, {counted(report.frames, 'frame')}, "
            f"{counted(report.lost, 'frame')} lost"
        )
        echo(f"{', '.join(map(str, report.files))}: {counts}")
        if report.text and not report.complaint:
            echo(report.text)
    if report.complaint:
        echo(f"acquire: {report.complaint}", err=True)
    if report.complaint or report.lost:
        sys.exit(3)
