"""What prints the tables of an archive's results, for the test of tables at 80 columns."""

from __future__ import annotations

import pyarrow as pa

from analyze.batch import summary_output
from analyze.batch.object_output import render_object
from analyze.batch.object_sessions import object_over_sessions
from analyze.batch.summary import Repeated, Summary, summarise
from analyze.verbs.archive.list_ import _print as print_list
from tests.analyze.batch.months_of_sessions import ageing_rig, drawn_table


def show_archive() -> None:
    sha = "0123456789abcdef"
    rows = [
        Repeated(
            "a long name of a tea box", sha, name, unit, 12, 1.2345, 0.0123, 0.0045, 9.1, 0.5, 0.01, 0.02, 10
        )
        for name, unit in (("centre of mass, x", "mm"), ("Ixx", "10⁻⁶ kg m²"))
    ]
    failures = (("too_few_strikes", 12, "2026/long-folder/session-0012.mcap: 2 strikes: 3 are needed"),)
    objects = (("a long name of a tea box", sha, 12, 120, 110, 3),)
    summary_output.render_summary(Summary(24, failures, tuple(rows), objects))


def show_control() -> None:
    summary_output.render_summary(summarise(drawn_table(40, ageing_rig)))


def show_object() -> None:
    render_object(object_over_sessions(drawn_table(12, ageing_rig), "salt"))


def show_list() -> None:
    row = {
        "created": "2026-11-30T08:00:00+00:00",
        "object": "a long name of a tea box",
        "rig": "bench-a",
        "strikes": 9,
        "size_bytes": 873_000_000,
        **{f"com_{axis}_mm": -12.345 for axis in "xyz"},
        **{f"com_sd_{axis}_m": 2e-4 for axis in "xyz"},
        "com_observed": True,
        "flags": ["compacted", "recovered"],
        "url": "2026/long-folder/session-0012.mcap",
    }
    print_list(pa.Table.from_pylist([row]))


ARCHIVE_TABLES = {
    "analyze.batch.summary_output": show_archive,
    "analyze.batch.control_output": show_control,
    "analyze.batch.object_output": show_object,
    "analyze.verbs.archive.list_": show_list,
}
"""modules that make tables for the terminal, and what makes them print these"""
