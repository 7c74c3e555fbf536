"""Client of the daemon that carries out a session: it executes the actions of the state machine."""

from __future__ import annotations

import base64
import contextlib
import time
from collections.abc import Callable
from pathlib import Path

from acquire.config import RigLimits
from acquire.daemon.client import DaemonClient
from acquire.errors import (
    RecordingBroken,
    SessionError,
    StrikerError,
    StrikerLost,
    StrikerNotFound,
    StrikerRefused,
    StrikerStopped,
)
from acquire.session import actions, events, waits
from acquire.session.adaptive import estimate_text
from acquire.session.countdown import count_down, hands_are_near
from acquire.session.holds import wait_while_held
from acquire.session.machine import State
from acquire.session.options import DEFAULT_OPTIONS, SessionOptions
from acquire.session.plan_fit import camera_pose_problem, striker_limit_problem
from acquire.session.progress import ProgressReporter
from acquire.session.session_input import SessionInput
from acquire.session.session_report import SessionReport
from acquire.session.strike_record import strike_record
from acquire.session.toss_steps import TossSteps
from acquire.session.tosses import session_machine
from acquire.striker.base import StrikerState
from schemas.strike_plan import PlannedStrike
from schemas.watch_lines import AdviceRequest, SessionEstimate, StrikeVerdict, WatchEvent
from schemas.wording import counted

Progress = Callable[[str, int, int], None]
"""called with a text, the number of planned strikes done, and the number of all planned strikes"""


class SessionRunner:
    """Runner of one session, from opening the recording to closing it.

    Args:
        client: client of the running daemon.
        given: object and plan of the session.
        output: path of the recording to write.
        progress: called with a text, the number of planned strikes done, and the number of all planned
            strikes.
        options: how it is carried out.

    Raises:
        SessionError: nothing is left to be done, as every planned strike was made before.
    """

    def __init__(
        self,
        client: DaemonClient,
        given: SessionInput,
        output: Path,
        progress: Progress = lambda *_: None,
        options: SessionOptions = DEFAULT_OPTIONS,
    ) -> None:
        self._client, self._input, self._output = client, given, output
        self._progress, self._options = progress, options
        self._machine = session_machine(given.plan, options, untagged=given.untagged)
        self._tosses = TossSteps(client.call, self._report, self._clear_fault, untagged=given.untagged)
        self._status = ProgressReporter(client.call, given, output, lambda: self._machine.progress, options)
        self._anchor_ns = 0
        self._ordered = 0
        """number of strikes commanded to the striker"""
        self._kept = 0
        """number of strikes whose record is in the file"""
        self._frames = 0
        self._lost = 0

    def run(self) -> SessionReport:
        """Open the recording, carry out the plan's strikes and close the recording.

        If the session fails after the recording was opened, the striker is stopped. The recording so far is
        kept if the striker was ordered to strike, and deleted otherwise.

        Returns:
            Files, and numbers of strikes and frames, also if the session was stopped by the operator or by
            too many faults.

        Raises:
            SessionError: the plan does not fit the rig's striker, or the daemon refuses the session.
            StrikerError, CameraError, RecorderError, DaemonError: as the daemon reports them.
        """
        limits = RigLimits.from_dict(self._client.call("rig"))
        if problem := striker_limit_problem(self._input.plan, limits):
            raise SessionError(
                f"{self._input.plan_path}: does not fit this rig's striker: {problem}: "
                f"{self._input.replan_advice}"
            )
        shape = self._input.shape
        opened = self._client.call(
            "recording.open",
            path=str(self._output.resolve()),
            object_toml=self._input.object_toml,
            object_name=str(self._input.object_path),
            plan_json=self._input.plan_json,
            plan_name=str(self._input.plan_path),
            shape_name=shape[0] if shape else None,
            shape_base64=base64.b64encode(shape[1]).decode() if shape else None,
        )
        self._anchor_ns = int(opened["wall_anchor_ns"])
        if problem := camera_pose_problem(self._input.plan, limits):
            self._report(f"{self._input.plan_path}: {problem}: {self._input.replan_advice}")
        event: events.Event = events.Started()
        try:
            self._report(f"homing the striker{waits.at_most(waits.HOME_TIMEOUT_S)}")
            self._announce(actions.Announce(State.IDLE, "", 0, self._options.note))
            self._client.call("striker.home", after_stop=False)
            while True:
                for action in self._machine.handle(event):
                    if isinstance(action, actions.CloseRecording):
                        return self._close_recording(action)
                    answer = self._execute(action)
                    if answer is not None:
                        event = answer
                    if isinstance(answer, events.FileCutShort | events.StopRequested):
                        break  # the actions that remain follow the repeated strike, or are dropped
        except BaseException:
            with contextlib.suppress(Exception), self._client.another() as client:
                client.call("striker.stop")
                self._keep_or_discard([Path(path) for path in client.call("recording.close")["files"]])
            raise

    def _report(self, text: str) -> None:
        self._progress(text, *self._machine.progress)

    def _keep_or_discard(self, files: list[Path]) -> None:
        """Delete a failed session's files if no strike was ordered, else keep them; report what was done."""
        names = ", ".join(map(str, files))
        if not files:
            return
        if self._ordered or self._tosses.begun:
            unjudged = self._ordered - self._kept
            more = f", and {unjudged} without a verdict" if unjudged else ""
            self._report(f"kept: {counted(self._kept, 'strike')}{more}{self._tosses.text} in {names}")
            return
        for path in files:
            path.unlink(missing_ok=True)
        self._report(f"discarded: {names}: no strike was ordered yet")

    def _close_recording(self, action: actions.CloseRecording) -> SessionReport:
        self._report(f"finishing the recording{waits.at_most(waits.CLOSE_TIMEOUT_S)}")
        report = self._client.call("recording.close")
        if self._kept:
            self._report(f"learned: {self._machine.learner.striker.text()}")
        return SessionReport(
            path=Path(report["path"]),
            files=tuple(Path(path) for path in report["files"]),
            strikes=self._kept,
            tosses=self._tosses.kept,
            frames=int(report["frames"]),
            lost=int(report["lost"]),
            aborted=action.aborted,
            text=action.text,
            skipped=self._machine.skipped,
            missed=action.missed,
        )

    def _execute(self, action: actions.Step) -> events.Event | None:
        """Execute an action of the state machine and return the event that results; None if there is none.

        If the file with the images was cut short, the event is FileCutShort.
        """
        try:
            return self._call_daemon(action)
        except RecordingBroken as error:
            self._report(f"{error}: strike again")
            return events.FileCutShort(str(error))

    def _call_daemon(self, action: actions.Step) -> events.Event | None:
        event: events.Event | None = None
        match action:
            case actions.Announce():
                self._announce(action)
            case actions.AskToPlace(strike=strike, hint=hint):
                event = self._ask_to_place(strike, hint)
            case actions.CheckPose(strike=strike):
                event = self._check_pose(strike)
            case actions.Arm():
                event = self._arm_when_released()
            case actions.ClearFault():
                event = self._clear_fault()
            case actions.Strike():
                event = self._strike(action)
            case actions.RecordUntilRest():
                event = self._record_until_rest()
            case actions.Judge() | actions.Advise():
                event = self._ask_analysis(action)
            case actions.WriteRecord():
                self._write_record(action)
            case _:
                event = self._tosses.execute(action)
        return event

    def _announce(self, action: actions.Announce) -> None:
        self._client.call(
            "recording.state",
            state=action.state,
            strike_id=action.strike_id,
            attempt=action.attempt,
            text=action.text,
            toss_id=action.toss_id,
        )
        self._status.announce(action)
        name = State.Name(action.state).replace("_", " ").lower() + waits.longest_in(action.state)
        self._report(f"{action.strike_id or action.toss_id} {name} {action.text}".strip())

    def _ask_to_place(self, strike: PlannedStrike, hint: str) -> events.Event:
        self._client.call("watch.expect", plan_strike_id=strike.id)  # for the outline beside the question
        rotation, p = strike.R_world_object, strike.p_world_object
        impact = [sum(rotation[i][j] * strike.aim.impact.point[j] for j in range(3)) + p[i] for i in range(3)]
        answer = self._client.call(
            "prompt",
            kind="place",
            strike_id=strike.id,
            edge=self._status.edge(strike.id),
            text=strike.card,
            hint=hint,
            R_world_object=rotation,
            p_world_object=p,
            impact_point_world=impact,
            heading_rad=strike.heading_rad,
        )
        if not answer["ok"]:
            return events.StopRequested(answer["text"] or "stopped by the operator")
        order = answer.get("order", "placed")
        return events.Placed() if order == "placed" else events.Ordered(events.Order(order))

    def _check_pose(self, strike: PlannedStrike) -> events.Event:
        since_ns = int(self._client.call("watch.expect", plan_strike_id=strike.id)["now_ns"])
        end = time.monotonic() + waits.POSE_TIMEOUT_S
        text, seen_ns = "none of the object's markers is in view", 0
        alive_until = time.monotonic() + waits.WATCHER_RESTART_S
        while time.monotonic() < end:
            answer = self._client.call("watch.latest")
            if answer["alive"]:
                alive_until = time.monotonic() + waits.WATCHER_RESTART_S
            elif time.monotonic() > alive_until:
                return events.PoseChecked(
                    good=True, text="analyze watch is not running: the placement was not checked"
                )
            event = WatchEvent.model_validate(answer["event"]) if answer["event"] else None
            if event is not None and seen_ns < event.time_ns <= since_ns:
                # A restarted `analyze watch` reads the recording from its beginning: let it catch up.
                seen_ns, end = event.time_ns, time.monotonic() + waits.POSE_TIMEOUT_S
            if event and event.time_ns > since_ns and (event.markers or self._input.untagged):
                error = event.placement_error_rad
                if hands_are_near(event):
                    text = "something moves beside the object: take your hands away"
                    time.sleep(0.05)
                    continue
                if event.at_rest and self._input.is_placed(error, event.text):
                    return events.PoseChecked(good=True)
                if event.at_rest and error is None and self._input.lacks_places(event.markers):
                    self._report(f"{strike.id}: placement not checked: {event.text}")
                    return events.PoseChecked(good=True, text=event.text)
                text = event.text or "the object does not come to rest"
            time.sleep(0.05)
        trouble = self._client.call("status")["trouble"]
        return events.PoseChecked(good=False, text=trouble or text)

    def _arm_when_released(self) -> events.Event:
        """Arm the striker after the countdown.

        If somebody came near the object or the session was held, check the pose first.
        """
        undisturbed = count_down(self._client.call, self._status, self._options.countdown_s)
        held = wait_while_held(self._client.call, self._machine, self._status, self._report)
        if isinstance(held, events.StopRequested):
            return held
        return self._check_pose(self._machine.strike) if held or not undisturbed else self._arm()

    def _arm(self) -> events.Event:
        try:
            self._client.call("striker.arm")
            self._client.call("striker.cock")
        except StrikerError as error:
            return self._striker_failed(error)
        return events.Ready()

    def _clear_fault(self) -> events.StopRequested | None:
        """Home the striker; while its servo does not answer, wait and try again.

        Returns:
            None when the striker is homed; a StopRequested event if the striker was stopped meanwhile.

        Raises:
            StrikerNotFound, StrikerLost: the servo did not answer within the wait given to the constructor.
            StrikerError: homing failed otherwise.
        """
        end = time.monotonic() + self._options.servo_timeout_s
        reported = ""
        while True:
            try:
                self._client.call("striker.home", after_stop=False)
            except StrikerStopped as error:
                return events.StopRequested(str(error))
            except (StrikerNotFound, StrikerLost) as error:
                if time.monotonic() > end:
                    raise
                if str(error) != reported:
                    reported = str(error)
                    self._report(
                        f"waiting for the striker{waits.at_most(self._options.servo_timeout_s)}: {reported}"
                    )
                time.sleep(waits.SERVO_RETRY_S)
            else:
                return None

    def _striker_failed(self, error: StrikerError) -> events.Event:
        """Event that follows from an error of the striker while arming, cocking or swinging.

        Returns:
            StopRequested, which ends the session, if the striker was stopped or refused the order without
            being in a fault; StrikerFailed, whose fault can be cleared, otherwise.
        """
        in_fault = self._client.call("status")["striker"] == StrikerState.FAULT.value
        if isinstance(error, StrikerStopped) or (isinstance(error, StrikerRefused) and not in_fault):
            return events.StopRequested(str(error))
        return events.StrikerFailed(str(error))

    def _strike(self, action: actions.Strike) -> events.Event:
        self._client.call("window.open")
        self._ordered += 1  # from here on the file may hold images that cannot be made again
        try:
            outcome = self._client.call(
                "striker.strike", strike_id=action.strike_id, tip_speed_m_s=action.tip_speed_m_s
            )
        except StrikerError as error:
            with contextlib.suppress(RecordingBroken):  # this window is not needed
                self._client.call("window.close")
            return self._striker_failed(error)
        names = ("contact_time_ns", "contact_time_sd_ns", "tip_speed_m_s", "contacts")
        return events.Struck(**{name: outcome[name] for name in names})

    def _record_until_rest(self) -> events.Event:
        start = time.monotonic()
        struck_ns, end_ns = time.monotonic_ns() + self._anchor_ns, 0
        while time.monotonic() - start < waits.LATE_TIMEOUT_S:
            time.sleep(0.05)
            answer = self._client.call("watch.latest")
            event = answer["event"] if answer["alive"] else None
            if event is None:  # `analyze watch` is not running: record for a fixed time
                if time.monotonic() - start > waits.REST_TIMEOUT_S:
                    break
                continue
            since_s = 1e-9 * (event["time_ns"] - struck_ns)
            if since_s > waits.REST_TIMEOUT_S or (event["at_rest"] and since_s > waits.REST_MINIMUM_S):
                end_ns = event["time_ns"]
                break
        report = self._client.call("window.close", end_ns=end_ns)
        frames, lost = int(report["frames"]), int(report["lost"])
        self._frames, self._lost = self._frames + frames, self._lost + lost
        return events.Recorded(int(report["start_ns"]), int(report["end_ns"]), frames, lost)

    def _ask_analysis(self, action: actions.Judge | actions.Advise) -> events.Event:
        return self._judge(action) if isinstance(action, actions.Judge) else self._advise(action.request)

    def _judge(self, action: actions.Judge) -> events.Event:
        contact = action.struck.contact_time_ns
        answer = self._client.call(
            "watch.judge",
            plan_strike_id=action.strike.id,
            strike_id=action.strike_id,
            window_start_ns=action.recorded.window_start_ns,
            window_end_ns=action.recorded.window_end_ns,
            contact_time_ns=contact + self._anchor_ns if contact else 0,
            timeout_s=waits.JUDGE_TIMEOUT_S,
        )["verdict"]
        return events.Judged(StrikeVerdict.model_validate(answer) if answer else None)

    def _advise(self, request: AdviceRequest) -> events.Event:
        found = self._client.call("watch.advise", **request.model_dump(), timeout_s=waits.ADVICE_TIMEOUT_S)
        estimate = SessionEstimate.model_validate(found["estimate"]) if found["estimate"] else None
        if text := estimate_text(estimate):
            self._report(text)
        return events.Advised(estimate)

    def _write_record(self, action: actions.WriteRecord) -> None:
        verdict = action.verdict
        self._client.call("recording.strike", **strike_record(action, self._anchor_ns))
        self._kept += 1
        self._status.add_strike(action)
        energy = f", energy ratio {verdict.energy_ratio:.2f}" if verdict and verdict.energy_ratio else ""
        code = verdict.code.value.replace("_", " ") if verdict else "no verdict"
        self._report(f"{action.strike_id}: {code}{energy}")
