"""A query of gathered rows reads the files' own columns, and writes into none of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from analyze.batch.ledger import Entry, Ledger
from analyze.batch.query import run_query
from analyze.batch.result_rows import write_row
from analyze.batch.stored_results import GATHER_FROM_ROWS, GATHERED
from analyze.batch.worker_messages import ROWS
from analyze.errors import ArchiveError

KEYS = [f"k{number:02d}" for number in range(GATHER_FROM_ROWS)]
COUNT = "select object, count(*) as n from recordings group by object"


def write_results(output: Path, object_name: str = "cube") -> Path:
    """Write rows of results, as many as are gathered, and their ledger; the folder."""
    (output / ROWS).mkdir(parents=True)
    for key in KEYS:
        write_row(
            {"key": key, "object": object_name, "url": f"/{key}.mcap"}, output / ROWS / f"{key}.parquet"
        )
    with Ledger(output, (1, 1), 1) as ledger:
        ledger.add(Entry(f"/{key}.mcap", key, "s", "v", key, "", "", []) for key in KEYS)
    return output


@pytest.mark.parametrize("name", ["object=teapot", "res[1]", "it's", "re*s", "what?"])
def test_the_name_of_the_folder_changes_no_row(tmp_path, name) -> None:
    write_results(tmp_path / "res1", "another")
    run_query(tmp_path / "res1", COUNT)
    output = write_results(tmp_path / name)
    assert run_query(output, COUNT).to_pylist() == [{"object": "cube", "n": len(KEYS)}]


@pytest.mark.parametrize(
    "sql",
    [
        "copy (select 'k00' as key) to '{part}' (use_tmp_file false)",
        "explain analyze copy (select 'k00' as key) to '{part}' (use_tmp_file false)",
        "copy (pivot (select 1 a, 2 b) on a using sum(b)) to '{part}' (use_tmp_file false)",
        "with x as (/**/CoPy (select 1) to '{part}' (use_tmp_file false)) select * from x",
        "select 'é', * from (with x as (copy (select 1) to '{part}' (use_tmp_file false)) from x)",
        "select 1; copy (select 'k00' as key) to '{part}' (use_tmp_file false)",
        "prepare p as copy (select 1) to '{part}' (use_tmp_file false)",
        "create table t as select 1",
    ],
)
def test_a_query_cannot_write(tmp_path, sql) -> None:
    output = write_results(tmp_path / "results")
    run_query(output, COUNT)
    (part,) = (output / GATHERED).glob("*.parquet")
    before = part.read_bytes()
    with pytest.raises(ArchiveError, match="query: is not one statement that reads"):
        run_query(output, sql.format(part=part))
    assert part.read_bytes() == before


@pytest.mark.parametrize(
    "sql",
    [
        "from recordings;",
        "select 'copy' as \"copy\" -- a comment",
        "describe recordings",
        "with x as (select key from recordings) select count(*) from x",
        "pivot recordings on object using count(*) group by url",
        "show tables",
    ],
)
def test_every_statement_that_reads_is_run(tmp_path, sql) -> None:
    assert run_query(write_results(tmp_path / "results"), sql).num_rows
