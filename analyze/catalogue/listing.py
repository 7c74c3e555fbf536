"""List and search a catalogue: each recording with its answer, its flags, and the state of its bytes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import duckdb
import pyarrow as pa

from analyze.batch.ledger import Entry, read_ledgers
from analyze.batch.stored_results import is_one_select, open_results
from analyze.catalogue.table import read_catalogue
from analyze.errors import ArchiveError

ANSWER_COLUMNS = (
    *("key", "strikes_used", "axes_used", "mass_kg", "com_x_m", "com_y_m", "com_z_m", "com_sd_x_m"),
    *("com_sd_y_m", "com_sd_z_m", "com_observed", "ixx_kg_m2", "iyy_kg_m2", "izz_kg_m2"),
)
"""columns of the results that the listing shows"""
_FLAGS = """
    list_sort(list_distinct([flag for flag in list_concat(
        [
            case when c.state <> 'ok' then c.state end,
            case when c.compaction = 'exact' then 'compact' end,
            case when c.compaction = 'lossy' then 'lossy' end,
            case when c.rebases > 0 then 'rebased' end,
            case when c.losses > 0 then 'recovered' end,
            case when c.state = 'ok' and c.content_id is null then 'unsealed' end,
            case when c.tosses > 0 then 'tosses' end,
            case when c.time_source = 'container_pts' then 'imported' end,
            case when c.scrub in ('damaged', 'altered') then c.scrub end,
            case when l.url is null or (l.key <> '' and a.key is null) then 'not_analysed' end,
            nullif(l.failure, '')
        ],
        [warning.code for warning in coalesce(a.warnings, [])],
        [strike.verdict for strike in coalesce(a.strikes, []) if strike.verdict <> 'good']
    ) if flag is not null]))
"""
_LISTING = f"""
    create table listing as select
        c.*, {", ".join(f"a.{name}" for name in ANSWER_COLUMNS)},
        1e3 * a.com_x_m as com_x_mm, 1e3 * a.com_y_m as com_y_mm, 1e3 * a.com_z_m as com_z_mm,
        nullif(l.reason, '') as failure_reason, {_FLAGS} as flags
    from catalogue_given c
    left join ledger_given l on l.url = c.url
        -- A failure of former bytes, or their answer, is not one of these.
        and (l.key <> '' or l.source_id = c.source_id)
    left join recordings a on a.key = l.key
        and (l.source_id = c.source_id or a.content_id = c.content_id and a.object_sha256 = c.object_sha256)
    order by c.created, c.url
"""  # noqa: S608 - constants only


@dataclass(frozen=True)
class Selection:
    """Conditions that a recording must meet to be listed; all of them."""

    object: str = ""
    """glob of the object's name; "" for any"""
    rig: str = ""
    """glob of the rig's name; "" for any"""
    since: str = ""
    """earliest start, a year, month, day or time (ISO 8601, UTC); "" for any"""
    until: str = ""
    """latest start, likewise, the whole year, month or day included; "" for any"""
    flags: tuple[str, ...] = ()
    """flags that it must have"""
    com_mm: tuple[tuple[float, float] | None, ...] = (None, None, None)
    """ranges of the centre of mass along x, y and z of the object frame [mm]; None for any"""
    where: str = ""
    """SQL condition on the columns of the listing; "" for none"""

    def conditions(self) -> list[tuple[str, Sequence[object]]]:
        """SQL conditions with their parameters."""
        found: list[tuple[str, Sequence[object]]] = []
        for column, pattern in (("object", self.object), ("rig", self.rig)):
            if pattern:
                found.append((f"coalesce({column}, '') glob ?", [pattern]))
        if self.since:
            found.append(("created >= ?", [self.since]))
        if self.until:
            found.append(("created < ?", [self.until + "~"]))  # sorts after all digits and signs
        found += [("list_contains(flags, ?)", [flag]) for flag in self.flags]
        for axis, limits in zip("xyz", self.com_mm, strict=True):
            if limits is not None:
                found.append((f"com_observed and com_{axis}_mm between ? and ?", list(limits)))
        if self.where:
            found.append((f"({self.where})", []))
        return found


def list_recordings(output: Path, selection: Selection) -> pa.Table:
    """Recordings of a catalogue that meet all conditions, with their answers, in the order of their start.

    Args:
        output: folder of the results.
        selection: conditions.

    Returns:
        Table with the columns of the catalogue, those of `ANSWER_COLUMNS`, com_x_mm to
        com_z_mm, failure_reason, and `flags`: in words, what is particular of a recording.

    Raises:
        ArchiveError: there is no catalogue, a file is damaged, the SQL condition is not valid, or a flag is
            one that no recording has.
    """
    catalogue, ledger = read_catalogue(output), read_ledgers(output)
    entries = [ledger[url] for url in catalogue.column("url").to_pylist() if url in ledger]
    keys = list(dict.fromkeys(each.key for each in entries if each.key))
    with open_results(output, keys, []) as connection:
        connection.register("catalogue_given", catalogue)
        connection.register("ledger_given", _ledger_table(entries))
        connection.execute(_LISTING)
        connection.execute("set lock_configuration = true")
        _refuse_unknown_flags(connection, selection.flags)
        conditions = selection.conditions()
        where = " and ".join(f"({text})" for text, _ in conditions) or "true"
        parameters = [value for _, values in conditions for value in values]
        sql = f"select * from listing where {where}"  # noqa: S608
        try:
            if not is_one_select(connection, sql):
                raise ArchiveError(
                    "--where: is not one condition: give a condition on the columns without a semicolon"
                )
            return connection.sql(sql, params=parameters).to_arrow_table()
        except duckdb.Error as error:
            text = " ".join(str(error).split())
            raise ArchiveError(f"--where: {text}: `analyze archive list --json` shows the columns") from None


def _ledger_table(entries: Sequence[Entry]) -> pa.Table:
    names = ("url", "source_id", "key", "failure", "reason")
    columns = {name: pa.array([getattr(each, name) for each in entries], pa.string()) for name in names}
    return pa.table(columns)


def _refuse_unknown_flags(connection: duckdb.DuckDBPyConnection, flags: tuple[str, ...]) -> None:
    rows = connection.execute("select distinct unnest(flags) from listing order by 1").fetchall()
    known = [row[0] for row in rows]
    for flag in flags:
        if flag not in known:
            has = f"those that occur are {', '.join(known)}" if known else "no recording has a flag"
            raise ArchiveError(f"--flag {flag}: no recording has it: {has}")
