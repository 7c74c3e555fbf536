"""Sessions of objects of the virtual rig with contents: rows "on the rig" of `make bench-contents`.

Physics, contents and table are those that a user rehearses with (acquire/virtual), struck by a finger's push
without images (contact_session.py); the plan is `analyze plan --contents`. Nothing of it is shared with
planar.py but the formulas of the first sloshing mode.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from acquire.virtual.filled_object import with_contents
from acquire.virtual.given_contents import parse_contents
from acquire.virtual.objects import load_object
from analyze.pipeline.evidence import Evidence
from analyze.planning.plan import PlanRequest
from tests.benchmarks.contact_session import Table, session_of

OBJECTS = ("carton", "parcel", "juice", "spray")
"""objects, by turns"""
TABLE = Table(friction=0.7, restitution=0.1)
FILLED = (
    "nothing",
    "liquid:0.1:0.5",
    "liquid:0.2:0.5",
    "powder:0.2:30",
    "lump:0.1:0.2",
    "lump:0.2:0.2",
)
"""contents that are tried, as options of `acquire demo`"""


def rig_evidence(contents: str, seed: int) -> Evidence:
    """Evidence of a session of an object of the virtual rig with contents.

    Raises:
        ValueError: the planner refuses the object.
    """
    name = OBJECTS[seed % len(OBJECTS)]
    thing = replace(load_object(name, seed), friction=TABLE.friction)
    if contents != FILLED[0]:
        thing = with_contents(thing, parse_contents(contents), seed)
    rng = np.random.default_rng((0x0217, seed, *contents.encode()))
    session = session_of(thing, TABLE, rng, request=PlanRequest(contents=True))
    if session is None:
        raise ValueError(f"the planner refuses {name}")
    return session.evidence
