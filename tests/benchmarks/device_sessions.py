"""One struck session with each make of camera and each striker: the whole virtual rig, up to its answer.

World, camera, daemon, one planned strike, and its recording against the ground truth. The camera renders the
world's images; the servo moves the world's arm.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from acquire.errors import AcquireError
from schemas.strike_result import Verdict
from tests.system.session_rig import PlanRefused
from tests.system.struck_session import StruckSession, struck_session

if TYPE_CHECKING:
    from acquire.virtual.device_kinds import DeviceKinds

ATTEMPTS = 3
"""sessions that are tried until one yields a good strike: a busy computer disturbs strikes and servo"""
SIGMAS = 3.0
"""error of the balance angle, in standard deviations, up to which it counts as found"""
LATE_MS = 0.5
"""delay of the stamps up to which the stated instant counts as applied; a wrong one shifts them by 1.5 ms"""


def session_cell(kinds: DeviceKinds) -> str:
    """Result of one struck session, for a table."""
    if kinds.camera == "v4l2" and (os.getuid() != 0 or not Path("/dev/fuse").exists()):
        return "not run: needs root and FUSE"
    before: list[str] = []
    for _ in range(ATTEMPTS):
        try:
            found = struck_session(kinds)
        except PlanRefused as reason:
            return f"no plan: {reason}"
        except (AssertionError, AcquireError) as reason:
            before.append(f"{reason} (load {os.getloadavg()[0]:.0f})")
            continue
        if found.phi_errors_rad and not found.lost:
            return "; ".join([described(found), *(f"earlier: {each}" for each in before)])
        before.append(f"{described(found)} (load {os.getloadavg()[0]:.0f})")
    return f"FAILED: {'; '.join(before)}"


def described(found: StruckSession) -> str:
    """Figures of a session in words; FAILED before those that are out of bounds."""
    wrong = [
        abs(error) > SIGMAS * sd for error, sd in zip(found.phi_errors_rad, found.phi_sds_rad, strict=True)
    ]
    angles = "; ".join(
        f"phi {1e3 * error:+.2f} ± {1e3 * sd:.2f} mrad"
        for error, sd in zip(found.phi_errors_rad, found.phi_sds_rad, strict=True)
    )
    delays = ", ".join(f"{delay:+.2f}" for delay in found.delays_ms)
    late = any(abs(delay) > LATE_MS for delay in found.delays_ms)
    failed = "FAILED: " if any(wrong) or late or found.lost or not angles else ""
    again = [verdict for verdict in found.verdicts if verdict != Verdict.GOOD.value]
    unsent = f" ({found.pace.unsent} of them never sent)" if found.pace.unsent else ""
    return (
        f"{failed}{angles or 'no good strike'}; stamps {delays or '-'} ms late; "
        f"{found.lost} of {found.frames} lost{unsent}{'; repeated: ' if again else ''}{', '.join(again)}"
    )
