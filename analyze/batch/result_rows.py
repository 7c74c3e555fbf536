"""Rows of results, one per recording: columns (SI units), and reading and writing as Parquet files."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow as pa
import pyarrow.parquet as pq

from analyze.batch.rig_columns import rig_columns, shared_columns
from analyze.batch.unwritable import cannot_be_written
from analyze.errors import ArchiveError
from analyze.types import TENSOR_ENTRIES, tensor_entry_name
from schemas.output_file import OutputError, write_bytes
from schemas.quantity import Quantity
from schemas.result import Result

if TYPE_CHECKING:
    from analyze.result.answer import Answer

_F, _S, _I, _B = pa.float64(), pa.string(), pa.int64(), pa.bool_()
_STRIKE = pa.struct(
    [
        ("id", _S),
        ("plan_strike", _S),
        ("axis", _S),
        ("verdict", _S),
        ("used", _B),
        ("reason", _S),
        ("phi_rad", _F),
        ("phi_sd_rad", _F),
        ("k_per_s2", _F),
        ("k_sd_per_s2", _F),
        ("energy_ratio", _F),
        ("residual_rms_rad", _F),
    ]
)
_AXIS = pa.struct(
    [("axis", _S), ("i_edge_kg_m2", _F), ("i_edge_sd_kg_m2", _F), ("i_com_kg_m2", _F), ("i_com_sd_kg_m2", _F)]
)
_REGION = pa.struct([("name", _S), ("mass_kg", _F), ("sd_kg", _F), ("low_kg", _F), ("high_kg", _F)])
_WARNING = pa.struct([("code", _S), ("text", _S)])
TENSOR_COLUMNS = {tensor_entry_name(entry).lower(): entry for entry in TENSOR_ENTRIES}
"""tensor entries by the prefix of their columns' names"""

SCHEMA = pa.schema(
    [
        ("url", _S),
        ("files", pa.list_(_S)),
        ("size_bytes", _I),
        ("source_id", _S),
        ("status", _S),
        ("failure", _S),
        ("reason", _S),
        ("key", _S),
        ("content_id", _S),
        ("analysis_version", _S),
        ("settings", _S),
        ("recording_id", _S),
        ("created", _S),
        ("object", _S),
        ("object_sha256", _S),
        ("plan_sha256", _S),
        ("recorded_by", _S),
        ("estimated_by", _S),
        ("time_source", _S),
        ("camera", _S),
        ("rig", _S),
        ("camera_serial", _S),
        ("striker", _S),
        ("frames_lost", _I),
        ("strikes_recorded", _I),
        ("strikes_used", _I),
        ("axes_used", _I),
        ("mass_kg", _F),
        *((f"com_{axis}_m", _F) for axis in "xyz"),
        *((f"com_sd_{axis}_m", _F) for axis in "xyz"),
        *((f"com_shared_sd_{axis}_m", _F) for axis in "xyz"),
        ("com_own_covariance_m2", pa.list_(_F)),
        ("com_observed", _B),
        *((f"{name}_kg_m2", _F) for name in TENSOR_COLUMNS),
        *((f"{name}_sd_kg_m2", _F) for name in TENSOR_COLUMNS),
        *((f"{name}_measured", _B) for name in TENSOR_COLUMNS),
        ("regions_explained", _B),
        ("regions", pa.list_(_REGION)),
        ("moments", pa.list_(_AXIS)),
        ("strikes", pa.list_(_STRIKE)),
        *(
            (name, _F)
            for name in (
                *("range_ratio", "range_ratio_sd", "rest_turn_rad", "rest_turn_sd_rad"),
                *("tilt_x_rad", "tilt_x_sd_rad", "tilt_y_rad", "tilt_y_sd_rad"),
                *("striker_speed_ratio", "striker_speed_ratio_sd"),
                *("frame_rate_ratio", "frame_rate_ratio_sd"),
            )
        ),
        ("verdict", pa.list_(_S)),
        ("warnings", pa.list_(_WARNING)),
        ("result_json", _S),
        ("seconds", _F),
        ("peak_memory_bytes", _I),
        ("analysed_at", _S),
    ]
)
"""columns of a recording's row, in SI units and radians.

Centre of mass in the object frame O; inertia tensor about it, along the axes of O.
"""
BULKY_COLUMNS = ("files", "moments", "strikes", "verdict", "warnings", "result_json")
"""columns that take nearly all of a row's memory"""
STAMPS = ("seconds", "peak_memory_bytes", "analysed_at", "estimated_by", "result_json")
"""columns that may differ between two analyses of the same recording.

`result_json` contains the program's commit.
"""


def answer_columns(answer: Answer) -> dict[str, Any]:
    """Columns of a recording's row in the table of results that follow from its estimate: value by name.

    Names of quantities end in the unit; an unknown value is None. The other columns (URL, status, key of the
    result, time and memory used) come from the batch run.
    """
    evidence, result = answer.estimate.evidence, answer.result
    manifest = evidence.manifest
    centre, tensor = _numbers(result.centre_of_mass.value), result.inertia
    values, spread = _matrix(tensor.value), _matrix(tensor.sd)
    measured = result.inertia_measured or [[None] * 3] * 3
    return {
        "files": list(evidence.recordings[0].files),
        "content_id": evidence.recordings[0].content_id,
        "recording_id": manifest.recording_id,
        "created": manifest.created,
        "object": evidence.spec.name,
        "object_sha256": evidence.object_sha256,
        "plan_sha256": manifest.plan_sha256,
        "recorded_by": manifest.software,
        "estimated_by": result.inputs.software,
        "time_source": manifest.time_source.value,
        "camera": f"{manifest.cameras[0].vendor} {manifest.cameras[0].model}".strip(),
        "frames_lost": sum(evidence.frames_lost.values()),
        "strikes_recorded": len(result.strikes),
        "strikes_used": sum(strike.used for strike in result.strikes),
        "axes_used": len({plane.axis_id for plane in answer.estimate.planes}),
        "mass_kg": _one(result.mass.value),
        **{f"com_{axis}_m": value for axis, value in zip("xyz", centre, strict=True)},
        **{
            f"com_sd_{axis}_m": value
            for axis, value in zip("xyz", _numbers(result.centre_of_mass.sd), strict=True)
        },
        **shared_columns(answer.estimate.sensitivity),
        "com_observed": result.centre_of_mass.observed,
        **{f"{name}_kg_m2": values[i][j] for name, (i, j) in TENSOR_COLUMNS.items()},
        **{f"{name}_sd_kg_m2": spread[i][j] for name, (i, j) in TENSOR_COLUMNS.items()},
        **{f"{name}_measured": measured[i][j] for name, (i, j) in TENSOR_COLUMNS.items()},
        "regions_explained": None if result.regions is None else result.regions.explained,
        "regions": _regions(result),
        "moments": [
            {
                "axis": each.axis_id,
                "i_edge_kg_m2": _one(each.i_edge.value),
                "i_edge_sd_kg_m2": _one(each.i_edge.sd),
                "i_com_kg_m2": _one(each.i_com.value),
                "i_com_sd_kg_m2": _one(each.i_com.sd),
            }
            for each in result.moments
        ],
        "strikes": [
            {
                "id": each.id,
                "plan_strike": each.plan_strike_id,
                "axis": each.axis_id,
                "verdict": each.verdict.value,
                "used": each.used,
                "reason": each.reason,
                "phi_rad": _value(each.phi),
                "phi_sd_rad": _sd(each.phi),
                "k_per_s2": _value(each.k),
                "k_sd_per_s2": _sd(each.k),
                "energy_ratio": each.energy_ratio,
                "residual_rms_rad": each.residual_rms_rad,
            }
            for each in result.strikes
        ],
        **rig_columns(evidence, result),
        "verdict": list(result.verdict or []),
        "warnings": [{"code": each.code.value, "text": each.text} for each in result.warnings],
        "result_json": answer.json(),
    }


def write_row(row: Mapping[str, Any], path: Path) -> None:
    """Write a Parquet file with one row; columns of `SCHEMA` that the row does not name are left out.

    They are null when it is read.

    Raises:
        OutputError: the file cannot be written.
    """
    # Statistics, dictionaries and Arrow's own schema are half of a file of one row.
    plain = {"write_statistics": False, "use_dictionary": False, "store_schema": False}
    named = pa.schema([field for field in SCHEMA if row.get(field.name) is not None])
    write_rows(pa.Table.from_pylist([dict(row)], schema=named), path, **plain)


def store_row(row: Mapping[str, Any], scratch: Path, output: Path, name: str) -> None:
    """Write a row into a folder of results, where its file appears complete or not at all.

    Args:
        row: values by column; columns of `SCHEMA` that it does not name are null.
        scratch: folder for the unfinished file, on the disk of the results.
        output: folder of the results.
        name: path of the file in it.

    Raises:
        ArchiveError: the file cannot be written.
    """
    part = scratch / "row.parquet"
    try:
        write_row(row, part)
        part.replace(output / name)
    except (OutputError, OSError) as error:
        raise cannot_be_written(output, error) from None


def write_rows(rows: pa.Table, path: Path, **options: Any) -> None:
    """Write rows into one Parquet file, which appears complete or not at all.

    Args:
        rows: the rows.
        path: file to write.
        options: options of `pyarrow.parquet.write_table`.

    Raises:
        OutputError: the file cannot be written.
    """
    buffer = BytesIO()
    pq.write_table(rows, buffer, compression="zstd", write_page_checksum=True, **options)
    write_bytes(path, buffer.getvalue())


def conform(stored: pa.Table, schema: pa.Schema) -> pa.Table:
    """Table with the columns of a schema; null are those that an older version did not write.

    Raises:
        ArrowException: a column is of a type that cannot be converted.
    """
    names = set(stored.column_names)
    columns = {
        field.name: stored.column(field.name).cast(field.type)
        if field.name in names
        else pa.nulls(len(stored), field.type)
        for field in schema
    }
    return pa.table(columns, schema=schema)


def read_rows(paths: Sequence[Path]) -> pa.Table:
    """Read the rows of Parquet files as one table in the order of the files; empty without files.

    Columns that an older version did not write are null.

    Raises:
        ArchiveError: a file is damaged.
    """
    tables = [_read(path) for path in paths]
    if not tables:
        return SCHEMA.empty_table()
    # In one piece: each piece costs a database half a megabyte.
    return conform(pa.concat_tables(tables, promote_options="default").combine_chunks(), SCHEMA)


def _read(path: Path) -> pa.Table:
    """Table in a file, with those columns of `SCHEMA` that the file has."""
    try:
        # Not `read_table`, which loads pandas, and takes three times as long for a file of one row.
        stored = pq.ParquetFile(path, page_checksum_verification=True).read()
        names = set(stored.column_names)
        fields = [field for field in SCHEMA if field.name in names]
        table = conform(stored, pa.schema(fields))
        table.validate(full=True)  # its texts, too
    except (pa.ArrowException, OSError) as error:
        if getattr(error, "errno", None) is not None:  # by the system; pyarrow's own are of damage
            raise
        raise ArchiveError(
            f"{path}: damaged: remove it, then run `analyze batch` again to make it anew"
        ) from None
    return table


def _regions(result: Result) -> list[dict[str, Any]]:
    if result.regions is None:
        return []
    return [
        {
            "name": region.name,
            "mass_kg": _one(region.mass.value),
            "sd_kg": _one(region.mass.sd),
            **dict(zip(("low_kg", "high_kg"), _numbers(region.mass.interval95, 2), strict=True)),
        }
        for region in result.regions.regions
    ]


def _value(quantity: Quantity | None) -> float | None:
    return None if quantity is None else _one(quantity.value)


def _sd(quantity: Quantity | None) -> float | None:
    return None if quantity is None else _one(quantity.sd)


def _one(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else None


def _numbers(value: object, count: int = 3) -> list[float | None]:
    return [_one(each) for each in value] if isinstance(value, list) else [None] * count


def _matrix(value: object) -> list[list[float | None]]:
    """Three rows of a 3 x 3 matrix, such as the inertia tensor of a Result document or its sd.

    `value` is a list of three rows, or of nine numbers row by row. Entries that are not finite are None; all
    are if `value` is not a list.
    """
    if not isinstance(value, list):
        return [[None] * 3] * 3
    return [
        _numbers(row)
        for row in (value if isinstance(value[0], list) else (value[0:3], value[3:6], value[6:9]))
    ]
