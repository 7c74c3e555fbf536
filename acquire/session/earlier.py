"""Strikes and tosses of earlier recordings of the same plan, with which a session goes on."""

from __future__ import annotations

import mmap
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from acquire.errors import SessionError
from acquire.recorder.file_series import newest_part, part_path
from schemas import topics
from schemas.mcap import records as container
from schemas.mcap.chunks import chunk_messages
from schemas.mcap.records import ContainerError
from schemas.mcap.walk import walk
from schemas.proto import percuss_pb2 as pb
from schemas.session_manifest import MANIFEST_NAME, PLAN_ATTACHMENT
from schemas.strike_result import Verdict
from schemas.toss_result import TossVerdict
from schemas.watch_lines import StrikeVerdict

if TYPE_CHECKING:
    from acquire.session.energy import EnergyLearner
    from schemas.strike_plan import StrikePlan


_Record = pb.StrikeRecord | pb.TossRecord
_KINDS: dict[str, type[_Record]] = {
    topics.SESSION_STRIKE.name: pb.StrikeRecord,
    topics.SESSION_TOSS.name: pb.TossRecord,
}
"""messages that are read, by topic"""


@dataclass(frozen=True)
class EarlierStrikes:
    """Strikes and tosses made before a session, from earlier recordings of the same object and plan."""

    paths: tuple[str, ...] = ()
    """absolute paths of the recordings"""
    strikes: tuple[pb.StrikeRecord, ...] = ()
    """records of the strikes, in the order of the recordings"""
    attempts: Counter[str] = field(default_factory=Counter[str])
    """number of the last attempt, by id of the planned strike or toss"""
    tosses: tuple[pb.TossRecord, ...] = ()
    """records of the tosses, in the order of the recordings"""

    @property
    def good(self) -> frozenset[str]:
        """Ids of the planned strikes that have a good strike."""
        good = Verdict.GOOD.value
        return frozenset(each.plan_strike_id for each in self.strikes if each.verdict_code == good)

    @property
    def good_tosses(self) -> frozenset[str]:
        """Ids of the planned tosses that have a good toss."""
        good = TossVerdict.GOOD.value
        return frozenset(each.plan_toss_id for each in self.tosses if each.verdict_code == good)


def read_earlier(paths: Sequence[Path], plan_json: str, plan_path: Path) -> EarlierStrikes:
    """Read the strikes and tosses of earlier recordings, each with the files that continue it.

    Args:
        paths: recordings, each by its first file.
        plan_json: text of the plan that the session goes on with.
        plan_path: its path, for messages.

    Raises:
        SessionError: a file cannot be read, is not finished, or was recorded with another plan.
    """
    records: list[_Record] = []
    for path in paths:
        for number in range(1, newest_part(path) + 1):
            records += _read_file(part_path(path, number), plan_json, plan_path)
    strikes = tuple(each for each in records if isinstance(each, pb.StrikeRecord))
    tosses = tuple(each for each in records if isinstance(each, pb.TossRecord))
    attempts: Counter[str] = Counter()
    for name, attempt in (
        *((each.plan_strike_id, each.attempt) for each in strikes),
        *((each.plan_toss_id, each.attempt) for each in tosses),
    ):
        attempts[name] = max(attempts[name], attempt)
    return EarlierStrikes(tuple(str(path.resolve()) for path in paths), strikes, attempts, tosses)


def _read_file(path: Path, plan_json: str, plan_path: Path) -> list[_Record]:
    """Strikes and tosses in one file of a recording.

    Raises:
        SessionError: it cannot be read, is not finished, or was recorded with another plan.
    """
    if not path.exists() and path.with_name(f"{path.name}.part").exists():
        raise SessionError(f"{path}.part: was not finished: run `acquire recover {path}.part` first")
    try:
        with path.open("rb") as file:
            data = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise SessionError(f"{path}: cannot be read: {reason}: check the path given to --resume") from None
    return _records_of(data, str(path), plan_json, plan_path)


def _records_of(data: memoryview, name: str, plan_json: str, plan_path: Path) -> list[_Record]:
    """Strikes and tosses in the content of one file of a recording.

    Raises:
        SessionError: the content is no recording, is damaged, or was recorded with another plan.
    """
    found: list[_Record] = []
    channels: dict[int, str] = {}
    is_recording = False
    try:
        for opcode, body in _records(data):
            if opcode == container.METADATA:
                is_recording |= container.parse_metadata(body).name == MANIFEST_NAME
            elif opcode == container.ATTACHMENT:
                _refuse_other_plan(container.parse_attachment(body), name, plan_json, plan_path)
            elif opcode == container.CHANNEL:
                channel = container.parse_channel(body)
                channels[channel.id] = channel.topic
            elif opcode == container.MESSAGE:
                message = container.parse_message(body)
                kind = _KINDS.get(channels.get(message.channel_id, ""))
                if kind is not None:
                    found.append(kind.FromString(bytes(message.data)))
    except ContainerError as error:
        raise SessionError(f"{name}: damaged: {error}: run `acquire recover {name}` first") from None
    if not is_recording:
        raise SessionError(f"{name}: is no recording: give a file that `acquire session` wrote")
    return found


def _refuse_other_plan(
    attachment: container.AttachmentRecord, name: str, plan_json: str, plan_path: Path
) -> None:
    """Raise SessionError if an attachment is another plan than the session's."""
    if attachment.name == PLAN_ATTACHMENT and bytes(attachment.data).decode(errors="replace") != plan_json:
        raise SessionError(
            f"{name}: was recorded with another plan than {plan_path}: give the plan it was recorded with, "
            "or begin a new session and estimate both recordings together"
        )


def _records(data: memoryview) -> Iterator[tuple[int, memoryview]]:
    """Yield opcode and content of every record, those within chunks included.

    Raises:
        ContainerError: a record is damaged.
    """
    if bytes(data[: len(container.MAGIC)]) != container.MAGIC:
        return
    for opcode, _, body in walk(data, len(container.MAGIC)):
        if opcode == container.DATA_END:
            return
        if opcode == container.CHUNK:
            chunk = container.parse_chunk(body)
            for inner, _, record in walk(chunk_messages(chunk) if chunk.compression else chunk.records):
                yield inner, record
        else:
            yield opcode, body
    raise ContainerError("ends early")


def learn_earlier(learner: EnergyLearner, plan: StrikePlan, earlier: EarlierStrikes) -> None:
    """Update a learner of tip speeds with the strikes of earlier recordings."""
    planned = {strike.id: strike for strike in plan.strikes}
    for each in earlier.strikes:
        strike = planned.get(each.plan_strike_id)
        if strike is None or each.tip_speed_command_m_s <= 0 or not each.verdict_code:
            continue
        verdict = StrikeVerdict(
            strike_id=each.strike_id,
            code=Verdict(each.verdict_code),
            reason=each.verdict_text,
            energy_ratio=each.energy_ratio or None,
        )
        if each.tip_speed_m_s > 0 or verdict.code is not Verdict.NOT_MOVED:
            learner.learn(strike, each.tip_speed_command_m_s, each.tip_speed_m_s or None, verdict)
