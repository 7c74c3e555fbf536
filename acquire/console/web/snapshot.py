"""State that the console shows: one JSON document, sent to every browser whenever it changes."""

from __future__ import annotations

from typing import Any, Literal

from schemas.document import Document
from schemas.session_status import SessionPhase

Role = Literal["operator", "watcher"]
"""operator: may give all orders; watcher: may look, and stop the striker"""
Mark = Literal["pass", "warn", "fail", "skip"]
"""outcome of a check"""


class DaemonView(Document):
    """Daemon of the rig: whether it runs, and its socket."""

    running: bool
    text: str
    socket: str


class CheckLine(Document):
    """One line of the preflight check."""

    name: str
    outcome: Mark
    text: str
    remedy: str


class CheckView(Document):
    """Preflight check of the rig: its lines, and whether all passed (null before the first check)."""

    running: bool
    passed: bool | None
    lines: list[CheckLine]


class CameraView(Document):
    """Camera: identity, settings, frames and losses, and aids for exposure and focus."""

    model: str
    serial: str
    fps: float
    exposure_us: float
    width: int
    height: int
    saturated_fraction: float | None
    """fraction of saturated pixels in the newest image; null if no image was looked at"""
    sharpness: float | None
    """variance of the image's Laplacian [grey levels squared]; the largest is the sharpest focus"""
    tag_px: float | None
    """mean side of the smallest marker in view [px]"""
    frames: int
    lost: int


class StrikerView(Document):
    """Striker: its state, the reason why it refuses to move, and whether the motor may have torque."""

    state: str
    text: str
    torque: bool | None


class DiskView(Document):
    """Disk of the recordings: free space, and the time until it is full at the present rate."""

    free_bytes: int
    minutes_left: float | None


class ObjectChoice(Document):
    """Object file in the folder of objects."""

    id: str
    name: str
    file: str


class PlanChoice(Document):
    """Strike plan that fits an object of the list."""

    id: str
    object_id: str
    name: str
    strikes: int


class Choices(Document):
    """Objects and plans with which a session can be started."""

    objects: list[ObjectChoice]
    plans: list[PlanChoice]


class StrikeView(Document):
    """Outcome of one attempt; angles in degrees, null if unknown."""

    id: str
    edge: str
    verdict: str
    reason: str
    phi_deg: float | None
    phi_sd_deg: float | None
    energy_ratio: float | None
    used: bool
    """true if the estimate can use it: its verdict is "good" or "rocked_back"; others follow from the reading
    of the whole recording"""
    curve: bool
    """true if GET /api/strikes/{id}/curve answers"""


class SessionView(Document):
    """Session that runs, or the last one."""

    id: str
    object: str
    plan: str
    state: SessionPhase
    text: str
    strike_id: str
    attempt: int
    done: int
    total: int
    earlier: int
    """number of strikes in the earlier recordings with which the session goes on"""
    max_strikes: int | None
    until: str
    paused: str | None
    """reason of the pause; null unless a pause is requested or in force"""
    file: str
    began_ns: int
    strikes: list[StrikeView]


class PromptView(Document):
    """Question to the operator: place the object for a strike."""

    id: int
    kind: str
    text: str
    hint: str
    strike_id: str
    edge: str
    card: str
    """address of the placement card's drawing; empty if there is none"""
    outline_px: list[list[float]] | None
    axes_px: list[list[float]] | None
    """object frame in the image [px]: origin and ends of x, y and z; null if it is not known"""
    offset_mm: list[float] | None
    angle_deg: float | None
    in_place: bool | None
    hands_off: bool


class ArmedView(Document):
    """Striker that is armed, or will be at the end of a countdown."""

    countdown_s: float | None
    """time until it is armed [s]; null once it is"""


class StopView(Document):
    """Whether the striker was stopped, and how long it took until the striker had the last stop."""

    stopped: bool
    text: str
    latency_ms: float | None
    was: str
    """state of the striker in which the console's last stop found it; empty before the first"""


class Snapshot(Document):
    """Everything that the pages show, for one browser."""

    time_ns: int
    role: Role
    operator_present: bool
    watchers: int
    daemon: DaemonView
    check: CheckView
    camera: CameraView | None
    striker: StrikerView | None
    disk: DiskView | None
    trouble: list[str]
    choices: Choices
    session: SessionView | None
    prompt: PromptView | None
    armed: ArmedView | None
    estimate: dict[str, Any] | None
    """newest document of kind "estimate" from `analyze watch`; null if there is none"""
    stop: StopView
