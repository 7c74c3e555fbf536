"""Answer of the sample recording with its frames late by an exposure, as a wrong stamp makes them."""

from __future__ import annotations

import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from click.testing import CliRunner
from mcap.reader import make_reader
from mcap.writer import Writer
from rich.console import Console
from rich.table import Table

from analyze.cli import main as analyze
from schemas import topics
from schemas.proto import percuss_pb2 as pb
from tests.places import FIRST_SAMPLE

DELAYS_MS = (1.5, 4.0)
FRAMES = (topics.raw_image("main").name, topics.frame_meta("main").name)


def write_later(source: Path, output: Path, delay_ns: int) -> None:
    """Copy a recording with all frames later by `delay_ns` [ns]."""
    with source.open("rb") as given, output.open("wb") as made:
        reader, writer = make_reader(given), Writer(made)
        summary, header = reader.get_summary(), reader.get_header()
        assert summary is not None
        writer.start(profile=header.profile, library=header.library)
        schemas = {
            number: writer.register_schema(each.name, each.encoding, each.data)
            for number, each in summary.schemas.items()
        }
        channels = {
            number: writer.register_channel(
                each.topic, each.message_encoding, schemas.get(each.schema_id, 0), each.metadata
            )
            for number, each in summary.channels.items()
        }
        for _, channel, message in reader.iter_messages():
            late_ns, data = delay_ns if channel.topic in FRAMES else 0, message.data
            if late_ns and channel.topic == FRAMES[1]:
                meta = pb.FrameMeta.FromString(data)
                meta.mid_exposure_host_ns += late_ns
                data = meta.SerializeToString()
            times = (message.log_time + late_ns, message.publish_time + late_ns)
            writer.add_message(channels[channel.id], times[0], data, times[1], message.sequence)
        for each in reader.iter_attachments():
            writer.add_attachment(each.create_time, each.log_time, each.name, each.media_type, each.data)
        for each in reader.iter_metadata():
            writer.add_metadata(each.name, each.metadata)
        writer.finish()


def answer(path: Path) -> dict[str, Any]:
    """Result of `analyze estimate`."""
    done = CliRunner().invoke(
        analyze, ["estimate", str(path), "--json", "--no-cache"], catch_exceptions=False
    )
    return json.loads(done.stdout)


def main() -> None:
    """Print how far balance angles and centre of mass move."""
    table = Table("frames later by [ms]", "balance angles, largest change [rad]", "centre of mass [mm]")
    with TemporaryDirectory() as folder:
        path = Path(folder) / "late.mcap"
        write_later(FIRST_SAMPLE, path, 0)
        before = answer(path)
        for delay_ms in DELAYS_MS:
            write_later(FIRST_SAMPLE, path, round(1e6 * delay_ms))
            after = answer(path)
            angles = [
                abs(a["phi"]["value"] - b["phi"]["value"])
                for a, b in zip(before["strikes"], after["strikes"], strict=True)
                if a["phi"] and b["phi"]
            ]
            com = [np.array(each["centre_of_mass"]["value"]) for each in (before, after)]
            moved_mm = 1000 * float(np.linalg.norm(com[1] - com[0]))
            table.add_row(f"{delay_ms:g}", f"{max(angles):.1g}", f"{moved_mm:.1g}")
    Console().print(table)


if __name__ == "__main__":
    main()
