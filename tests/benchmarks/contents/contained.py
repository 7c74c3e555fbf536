"""Whole sessions of boxes with a body inside, in a contact simulator: `--contained` of `make bench-contents`.

The box is that of `make bench-honesty` (struck.py: MuJoCo, a free body on a springy table, struck and struck
again in three dimensions). Inside it either nothing moves, or a lump slides between the walls of its cavity,
or a pendulum swings as the first sloshing mode of a liquid does. Plan, tracking errors, motion analysis and
answer are those of a real session; the plan is `analyze plan --contents`. It checks planar.py: the two
simulations share nothing.
"""

# mujoco takes its names from a compiled module that pyright cannot analyse.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from analyze.motion.settings import MotionSettings
from analyze.motion.strike import analyse_motion
from analyze.motion.strike_task import StrikeTask
from analyze.pipeline.evidence import Evidence
from analyze.pipeline.sections import next_face_angle, rolling_outline, strike_supports
from analyze.planning.examine import Bench
from analyze.planning.impact import StrikerModel
from analyze.planning.plan import PlanRequest, plan_strikes
from analyze.planning.prepared import FRICTION, prepare_object
from analyze.planning.view import default_camera
from analyze.types import TipMotion
from schemas.strike_plan import PlannedStrike
from tests.benchmarks.contents.sessions import first_usable
from tests.benchmarks.honesty import struck
from tests.benchmarks.honesty.bodies import Specimen
from tests.benchmarks.honesty.described import Description, description, planning_key
from tests.benchmarks.honesty.disturbances import DISTURBANCES
from tests.benchmarks.honesty.observed import T0, View, draw_view, observe
from tests.benchmarks.honesty.session import session_evidence, specimen
from tests.benchmarks.honesty.statics import G, true_tip

BODY = "sharp"
WALL = 0.004
"""thickness of the cavity's walls [m]"""
LUMP = 0.02
"""size of a lump [m]"""
TRIES = 3
ENERGY_SD = 0.03
DISTURBANCE = DISTURBANCES["none"]


@dataclass(frozen=True)
class Inside:
    """What moves inside a box."""

    name: str
    share: float = 0.0
    """its mass over that of the whole"""
    friction: float | None = None
    """friction of a lump on the walls; None for a pendulum"""


INSIDES = (
    Inside("nothing"),
    Inside("lump 10 %, µ 0.2", 0.1, 0.2),
    Inside("lump 20 %, µ 0.2", 0.2, 0.2),
    Inside("pendulum 10 %", 0.1),
    Inside("pendulum 20 %", 0.2),
)
"""insides that are tried, by name"""


@lru_cache(maxsize=4)
def planned(draw: int) -> Description:
    """Box as its user describes it, with the plan of a test of contents."""
    found = description(BODY, planning_key(DISTURBANCE), draw)
    assert found is not None
    bench = Bench(StrikerModel(fastest_m_s=5.0), default_camera(), FRICTION)
    prepared = prepare_object(found.model, found.spec, bench)
    plan = plan_strikes(prepared, found.plan.object_sha256, PlanRequest(contents=True))
    return replace(found, plan=plan)


def contained_evidence(inside: Inside, seed: int) -> Evidence:
    """Evidence of a session of the box with something inside."""
    made, described = specimen(BODY, seed), planned(seed % 4)
    rng = np.random.default_rng((0xC0B0D, seed))
    view, motions = draw_view(DISTURBANCE, rng), list[TipMotion]()
    for strike in described.plan.strikes:
        energies = strike.aim.energy_ratio * (1 + rng.normal(0, ENERGY_SD, TRIES))
        made_again = (
            _strike(described, made, inside, strike, (energy, attempt), view, rng)
            for attempt, energy in enumerate(energies.tolist())
        )
        motions.append(first_usable(made_again))
    return session_evidence(described, made, DISTURBANCE, motions, rng)


def _strike(
    described: Description,
    made: Specimen,
    inside: Inside,
    strike: PlannedStrike,
    how: tuple[float, int],
    view: View,
    rng: np.random.Generator,
) -> TipMotion:
    """Motion of a strike at an energy ratio, tracked and analysed; `how` also has the attempt's number."""
    energy, attempt = how
    R_rest = struck.true_rest_pose(made, np.array(strike.R_world_object))
    tilt = DISTURBANCE.tilt * made.lean
    tip = true_tip(made, R_rest, tilt)
    assert tip is not None
    mass = float(made.masses.sum())
    height = min(strike.aim.impact_height_m, 0.95 * struck._tall(made, R_rest))
    impulse = math.sqrt(2 * mass * G * tip.rise * energy * tip.i_edge) / height
    model = mujoco.MjModel.from_xml_string(contained_xml(made, inside, R_rest, tip.line, tilt))
    poses = struck._poses(model, made, R_rest, tip, (impulse, height, rng.uniform(0.002, 0.004)))
    over = struck._largest(poses[2], R_rest) > tip.phi + 0.1
    tracked, _ = observe(
        strike, struck.StruckMotion(*poses, R_rest, tip, energy, over), view, DISTURBANCE, rng
    )
    task = StrikeTask(
        f"{strike.id}.{attempt + 1}",
        strike,
        T0,
        None,
        rolling_outline(described.model, strike),
        next_face_angle(described.model, strike),
        supports=strike_supports(described.model, strike),
    )
    return analyse_motion(tracked, task, MotionSettings())


def contained_xml(
    made: Specimen, inside: Inside, R_rest: np.ndarray, line: np.ndarray, tilt: np.ndarray
) -> str:
    """Model (MJCF) of the box with something inside, at rest on a face, the pivot's centre `line` over y."""
    lighter = replace(
        made, masses=made.masses * (1 - inside.share), inertia=made.inertia * (1 - inside.share)
    )
    text = struck.model_xml(lighter, tilt)
    if not inside.share:
        return text
    half = np.abs(made.body.centres).max(axis=0) + made.body.radii.min() - WALL
    mass = inside.share * float(made.masses.sum())
    floor = half @ np.abs(R_rest[2])
    if inside.friction is None:
        width, depth = 2 * half @ np.abs(R_rest[0]), 0.7 * floor
        length = width / (math.pi * math.tanh(math.pi * depth / width))
        hinge = R_rest[2] * (length + 0.5 * depth - floor)
        axis = struck._text(R_rest[1])
        place = struck._text(-length * R_rest[2])
        swing = f'<joint type="hinge" axis="{axis}" damping="{0.5 * mass * length**2:.6g}"/>'
        bob = f'<inertial pos="{place}" mass="{mass:.6g}" diaginertia="1e-7 1e-7 1e-7"/>'
        child = f'<body pos="{struck._text(hinge)}">{swing}{bob}</body>'
        return text.replace("</body>\n</worldbody>", f"{child}\n</body>\n</worldbody>")
    contact = f'contype="2" conaffinity="2" friction="{inside.friction:.6g} 0.005 0.0001" solref="0.002 1"'
    walls = []
    for axis in range(3):
        for sign in (-1, 1):
            place, size = np.zeros(3), half + WALL
            place[axis], size[axis] = sign * (half[axis] + WALL / 2), WALL / 2
            walls.append(
                f'<geom type="box" pos="{struck._text(place)}" size="{struck._text(size)}" {contact}/>'
            )
    text = text.replace("</body>\n</worldbody>", "\n".join(walls) + "\n</body>\n</worldbody>")
    low = float((made.body.centres @ R_rest[2] - made.body.radii).min())
    beside = float(R_rest[1] @ np.array(made.body.struck_beside))
    origin = np.array([-float(R_rest[0] @ line), -beside, -low])
    local = -R_rest[2] * (floor - LUMP / 2)
    x, y, z, w = Rotation.from_matrix(R_rest).as_quat()
    turned = struck._text([w, x, y, z])
    lump = (
        f'<body pos="{struck._text(R_rest @ local + origin)}" quat="{turned}"><freejoint/>'
        f'<geom type="box" size="{LUMP / 2} {LUMP / 2} {LUMP / 2}" mass="{mass:.6g}" {contact}/></body>'
    )
    return text.replace("</worldbody>", f"{lump}\n</worldbody>")
