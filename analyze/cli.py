"""Command `analyze`: a group of subcommands (verbs), each defined in a module of `analyze.verbs`.

Exit codes: 0 done, 1 a named problem (one line on standard error), 2 wrong usage, 3 done, but some items
failed, 130 interrupted.
"""

from __future__ import annotations

import os

import click

from analyze.verbs.advise.command import advise
from analyze.verbs.archive.command import archive
from analyze.verbs.batch import batch
from analyze.verbs.cache import cache
from analyze.verbs.calibrate.command import calibrate
from analyze.verbs.cards import cards
from analyze.verbs.compact import compact
from analyze.verbs.estimate import estimate
from analyze.verbs.export import export
from analyze.verbs.fixture.command import fixture
from analyze.verbs.frame_rate.command import frame_rate
from analyze.verbs.gravity.command import gravity
from analyze.verbs.import_ import import_
from analyze.verbs.inspect.command import inspect
from analyze.verbs.parts import parts
from analyze.verbs.plan.command import plan
from analyze.verbs.predict import predict
from analyze.verbs.print_tags import print_tags
from analyze.verbs.query import query
from analyze.verbs.rebase.command import rebase
from analyze.verbs.register.command import register
from analyze.verbs.replay import replay
from analyze.verbs.report import report
from analyze.verbs.reproduce import reproduce
from analyze.verbs.rig_parts.command import rig_parts
from analyze.verbs.score import score
from analyze.verbs.shape import shape
from analyze.verbs.watch.command import watch
from schemas.command_line import Commands, version_option


@click.group("analyze", cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@version_option("analyze")
def main() -> None:
    """Plan strikes; turn recordings into centre of mass, inertia and region masses."""
    # One thread for the linear algebra: the matrices are small, and results must not depend on the number of
    # cores.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")


for _verb in (
    shape,
    fixture,
    plan,
    cards,
    estimate,
    score,
    report,
    replay,
    inspect,
    watch,
    advise,
    print_tags,
    reproduce,
    calibrate,
    frame_rate,
    import_,
    register,
    rebase,
    gravity,
    parts,
    rig_parts,
    export,
    predict,
    batch,
    archive,
    query,
    compact,
    cache,
):
    main.add_command(_verb)
