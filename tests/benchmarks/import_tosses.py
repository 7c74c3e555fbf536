"""Phone videos of strikes and tosses, imported and estimated: errors of the answer beside the truth.

    make bench-import-tosses                         # 6 sessions of three tosses, each imported twice
    python -m tests.benchmarks.import_tosses --seeds 1

The videos are those of `tests.phone_tosses`: 240 images a second, a rolling shutter of 7 us a row, H.264.
Each session is imported with the delay from row to row stated in the camera file, and without it. The strikes
are those of the plan of the phone sample, one set for all sessions; tosses and noise differ.
"""

from __future__ import annotations

import json
import tempfile
import tomllib
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import click
import cv2
import numpy as np
from click.testing import CliRunner
from rich.console import Console
from rich.table import Table

from analyze.cli import main as analyze
from tests import make_phone_videos as phone
from tests import phone_tosses
from tests.places import ROOT

SAMPLE = ROOT / "docs" / "examples" / "phone"
ENTRIES = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)
"""rows and columns of xx, yy, zz, xy, xz, yz"""

COLUMNS = (
    "line time",
    "sessions",
    "good tosses",
    "worst entry, median / largest [%]",
    "products, median [%]",
    "rms z of xx yy zz xy xz yz",
    "largest |z|",
    "c, median / largest [mm]",
    "rms z of c",
)


@dataclass(frozen=True)
class Score:
    """One session as estimated."""

    stated: bool
    """True if the camera file states the delay from row to row"""
    verdicts: tuple[str, ...]
    """verdicts of the tosses"""
    tensor: np.ndarray
    """(6,) errors of the tensor's entries, over the largest moment"""
    z: np.ndarray
    """(6,) errors over their standard deviations"""
    com: np.ndarray
    """(3,) error of c [m]"""
    com_z: np.ndarray
    """(3,) the same over its standard deviation"""


def camera_text(line_s: float | None) -> str:
    """Camera file of the phone, with or without its delay from row to row [s]."""
    line = "" if line_s is None else f"line_time_s = {line_s}\n"
    return (
        f"[camera.calibration]\nwidth = {phone.WIDTH}\nheight = {phone.HEIGHT}\nK = {phone.K.tolist()}\n"
        f"distortion = [{phone.K1}, 0, 0, 0, 0]\n{line}"
    )


def film() -> phone_tosses.Film:
    """Phone before the tea box, whose tags are glued on by hand."""
    spec = tomllib.loads((SAMPLE / "teabox.toml").read_text(encoding="utf-8"))
    return phone_tosses.Film(phone.box_sides(spec, np.random.default_rng(6)))


def write_strike(folder: Path, number: int) -> Path:
    """Video of a strike of the sample's plan, by its number from 0."""
    cv2.setNumThreads(1)
    random = np.random.default_rng((number, 0x57))
    strike = json.loads((SAMPLE / "plan.json").read_text(encoding="utf-8"))["strikes"][number]
    path = folder / f"{strike['id']}.mp4"
    phone.write_video(path, film().images(phone_tosses.struck(strike, random), random))
    return path


def write_toss(folder: Path, seed: int, number: int) -> Path:
    """Video of one of a session's tosses, by its number from 0."""
    cv2.setNumThreads(1)
    random = np.random.default_rng((seed, number, 0x7055))
    path = folder / f"t{number + 1}-{seed}.mp4"
    motion = phone_tosses.tossed(phone_tosses.SPINS[number], random)
    phone.write_video(path, film().images(motion, random))
    return path


def imported_answer(folder: Path, strikes: Sequence[Path], tosses: Sequence[Path], line_s: float | None):
    """Answer (JSON) of `analyze import` and `analyze estimate` for videos.

    Args:
        folder: folder for the recording.
        strikes: videos of strikes, named as in the sample's plan.
        tosses: videos of tosses.
        line_s: delay from row to row in the camera file [s]; None to state none.
    """
    name = f"{tosses[0].stem}-{'unstated' if line_s is None else 'stated'}"
    camera, recording = folder / f"{name}.toml", folder / f"{name}.mcap"
    camera.write_text(camera_text(line_s), encoding="utf-8")
    given = [word for path in tosses for word in ("--toss", path)]
    files = ["--object", SAMPLE / "teabox.toml", "--plan", SAMPLE / "plan.json", "--camera", camera]
    run("import", *strikes, *given, *files, "-o", recording, "--yes")
    return json.loads(run("estimate", recording, "--json"))


def run(*words: object) -> str:
    """Output of a command of `analyze`.

    Raises:
        RuntimeError: the command failed.
    """
    done = CliRunner().invoke(analyze, [str(word) for word in words])
    if done.exit_code:
        raise RuntimeError(f"analyze {words[0]}: {done.output}{done.stderr}")
    return done.stdout


def scored(answer: dict, *, stated: bool) -> Score:
    """Errors of an answer against the truth."""
    com, inertia = answer["centre_of_mass"], answer["inertia"]
    ends = np.array(com["interval95"])
    tensor = (np.array(inertia["value"]) - phone.INERTIA)[ENTRIES]
    off = np.array(com["value"]) - phone.COM
    return Score(
        stated,
        tuple(each["verdict"] for each in answer["flight"]["tosses"]),
        tensor / float(np.linalg.eigvalsh(phone.INERTIA).max()),
        tensor / np.array(inertia["sd"]).reshape(3, 3)[ENTRIES],
        off,
        off / (np.diff(ends, axis=1)[:, 0] / 3.92),
    )


def session(folder: Path, strikes: Sequence[Path], seed: int) -> list[Score]:
    """Scores of one session, with the delay from row to row stated and not."""
    tosses = [write_toss(folder, seed, number) for number in range(len(phone_tosses.SPINS))]
    return [
        scored(imported_answer(folder, strikes, tosses, line_s), stated=line_s is not None)
        for line_s in (phone_tosses.LINE_S, None)
    ]


@click.command()
@click.option("--seeds", default=6, help="sessions")
@click.option("--workers", default=2)
@click.option("--keep", type=click.Path(path_type=Path), help="folder in which the videos stay")
def main(seeds: int, workers: int, keep: Path | None) -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as aside, ProcessPoolExecutor(workers) as pool:
        folder = keep or Path(aside)
        folder.mkdir(exist_ok=True)
        strikes = list(pool.map(partial(write_strike, folder), range(6)))
        found = [
            score
            for both in pool.map(partial(session, folder, strikes), range(1, seeds + 1))
            for score in both
        ]
    table = Table(title="tea box, six strikes and three tosses filmed by a phone; tensor over largest moment")
    for column in COLUMNS:
        table.add_column(column, justify="right")
    for stated in (True, False):
        some = [each for each in found if each.stated is stated]
        worst = np.abs([each.tensor for each in some]).max(axis=1)
        z, com = np.array([each.z for each in some]), np.linalg.norm([each.com for each in some], axis=1)
        verdicts = [verdict for each in some for verdict in each.verdicts]
        table.add_row(
            "stated" if stated else "not stated",
            f"{len(some)}",
            f"{verdicts.count('good')} of {len(verdicts)}",
            f"{100 * np.median(worst):.2f} / {100 * worst.max():.2f}",
            f"{100 * np.median(np.abs([each.tensor[3:] for each in some])):.3f}",
            " ".join(f"{each:.2f}" for each in np.sqrt(np.mean(z**2, axis=0))),
            f"{np.abs(z).max():.2f}",
            f"{1e3 * np.median(com):.3f} / {1e3 * com.max():.3f}",
            f"{np.sqrt(np.mean([each.com_z**2 for each in some])):.2f}",
        )
    Console(width=200).print(table)


if __name__ == "__main__":
    main()
