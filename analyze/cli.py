"""The `analyze` command: verbs only; each hands over to the module that does the work.

Exit codes: 0 done, 1 a named problem (one line on standard error), 2 wrong usage, 130 interrupted.
"""

from __future__ import annotations

import os

import click

from analyze.commands.batch import batch, query
from analyze.commands.camera import calibrate
from analyze.commands.import_ import import_
from analyze.commands.markers import register
from analyze.commands.plan import plan
from analyze.commands.published import reproduce
from analyze.commands.recording import inspect, watch
from analyze.commands.replay import replay
from analyze.commands.result import estimate, report, score
from analyze.commands.shape import parts
from analyze.commands.simulator import export
from analyze.commands.table import gravity
from analyze.commands.tags import print_tags
from schemas.command_line import Commands


@click.group("analyze", cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="percuss")
def main() -> None:
    """Plan strikes; turn recordings into centre of mass, inertia and region masses."""
    # One thread for the linear algebra: the matrices are small, and results must not depend on the number of cores.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")


for _verb in (
    plan,
    estimate,
    score,
    report,
    replay,
    inspect,
    watch,
    print_tags,
    reproduce,
    calibrate,
    import_,
    register,
    gravity,
    parts,
    export,
    batch,
    query,
):
    main.add_command(_verb)
