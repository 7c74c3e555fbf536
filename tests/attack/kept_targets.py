"""Targets that take more than one file, or that the program itself wrote or publishes."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import numpy as np
import zstandard
from rosbags.rosbag2 import StoragePlugin

from analyze.reproduce.paper.record import ThetaSource, sealed_json
from analyze.reproduce.paper.session import Sweeps, session_record
from tests.analyze.flight.tossed_cube import tossed
from tests.analyze.importing.foreign_files import images, write_bag
from tests.analyze.reproduce.test_cube_tosses import CUBE
from tests.analyze.reproduce.test_cube_tosses import write as write_tosses
from tests.analyze.reproduce.test_planar_impacts import impacts
from tests.analyze.reproduce.test_planar_impacts import write as write_impacts
from tests.analyze.reproduce.theta_sessions import theta_session
from tests.analyze.sources.test_foreign_calibrations import CAMERA_INFO, ECHOED, KALIBR, PYTHONS
from tests.attack.forked import run_forked
from tests.attack.targets import Target, Verb, make_targets
from tests.places import ROOT

OWN_CACHE = "cache"
"""folder of kept results, in a target's folder"""


def make_all_targets(folder: Path) -> list[Target]:
    """Write whole files of every kind below `folder`; returns what is to be attacked."""
    found = make_targets(folder)
    folders = {each.kind: each.folder for each in found}
    return [
        *found,
        *_bags(folder, folders["plan"]),
        *_calibrations(folder, folders["plan"]),
        *_batch(folder, folders["recording"]),
        *_kept(folder, folders["recording"]),
        *_reproduced(folder),
        *_virtual(folder),
    ]


def _calibrations(folder: Path, texts: Path) -> list[Target]:
    """Calibrations that other programs write, in YAML and JSON."""
    place = folder / "calibrations"
    place.mkdir(exist_ok=True)
    for each in ("object.toml", "plan.json", "times.csv"):
        shutil.copy(texts / each, place / each)
    shutil.copytree(texts / "images", place / "images", dirs_exist_ok=True)
    given = ("--object", "object.toml", "--plan", "plan.json", "--times", "times.csv", "--camera", "{file}")
    verbs = (Verb("import --camera", ("analyze", "import", "images", *given, "-o", "new.mcap")),)
    files = {
        "ros.yaml": CAMERA_INFO,
        "kalibr.yaml": KALIBR,
        "echoed.json": json.dumps(ECHOED),
        "python.json": json.dumps(PYTHONS),
    }
    for name, text in files.items():
        (place / name).write_text(text, encoding="utf-8")
    return [Target(f"calibration ({name})", place, name, verbs, text=True) for name in files]


def _bags(folder: Path, texts: Path) -> list[Target]:
    """ROS 2 bags with either storage, plain and packed, and the file that describes them."""
    given = ("--object", "object.toml", "--plan", "plan.json", "--camera", "rig.toml", "--strike", "s1")
    found = []
    for name, storage, packed in (
        ("SQLite", StoragePlugin.SQLITE3, False),
        ("SQLite, packed messages", StoragePlugin.SQLITE3, True),
        ("SQLite, packed file", StoragePlugin.SQLITE3, False),
        ("MCAP", StoragePlugin.MCAP, False),
    ):
        place = folder / f"bag-{name.replace(', ', '-').replace(' ', '-')}"
        place.mkdir(exist_ok=True)
        for each in ("object.toml", "plan.json", "rig.toml"):
            shutil.copy(texts / each, place / each)
        shutil.rmtree(place / "bag", ignore_errors=True)
        bag = write_bag(place / "bag", images(8, 160, 120), storage=storage, compressed=packed)
        (path,) = (each for each in bag.iterdir() if each.suffix in {".db3", ".mcap"})
        if name.endswith("packed file"):
            path = _pack(path)
        verbs = (
            Verb("import", ("analyze", "import", "bag", *given, "--whole", "-o", "new.mcap")),
            Verb("inspect", ("analyze", "inspect", "bag")),
        )
        found.append(Target(f"bag ({name})", place, f"bag/{path.name}", verbs))
        if name == "SQLite":
            alone = Verb("import alone", ("analyze", "import", "{file}", *given, "--whole", "-o", "new.mcap"))
            found[-1] = Target(found[-1].kind, place, found[-1].file, (*verbs, alone))
            found.append(Target("bag's metadata", place, "bag/metadata.yaml", verbs, text=True))
    return found


def _pack(path: Path) -> Path:
    """Compress a bag's file as a whole, and state so in the bag's metadata; returns its new path."""
    packed = path.with_name(f"{path.name}.zstd")
    packed.write_bytes(zstandard.compress(path.read_bytes()))
    path.unlink()
    metadata = path.with_name("metadata.yaml")
    text = metadata.read_text(encoding="utf-8").replace(path.name, packed.name)
    text = text.replace("compression_format: ''", "compression_format: zstd")
    metadata.write_text(text.replace("compression_mode: ''", "compression_mode: file"), encoding="utf-8")
    return packed


def _batch(folder: Path, recordings: Path) -> list[Target]:
    place = _copied(recordings, folder / "batch")
    batch = Verb("batch", ("analyze", "batch", "quick.mcap", "--out", "results", "-j", "1"), usual_s=3.5)
    run_forked(batch.call(""), place, folder)
    query = ("analyze", "query", "--out", "results", "SELECT * FROM recordings, strikes, warnings")
    verbs = (
        Verb("query", query),
        Verb("query --json", (*query, "--json")),
        Verb("query --save", (*query, "--save", "new.csv")),
        batch,
    )
    row = next((place / "results" / "recordings").iterdir())
    return [
        Target("row of a batch", place, str(row.relative_to(place)), verbs, replaceable=True),
        Target("ledger of a batch", place, "results/ledger/all.jsonl", verbs, text=True, replaceable=True),
    ]


def _kept(folder: Path, recordings: Path) -> list[Target]:
    """Results kept in the cache: each command's cache is in its own working folder."""
    place = _copied(recordings, folder / "kept")
    estimate = Verb(
        "estimate", ("analyze", "estimate", "quick.mcap", "--json"), same=True, usual_s=2.0, cache=OWN_CACHE
    )
    run_forked(estimate.call(""), place, folder)
    verbs = (
        estimate,
        Verb("cache", ("analyze", "cache"), cache=OWN_CACHE),
        Verb("cache --list", ("analyze", "cache", "--list"), cache=OWN_CACHE),
        Verb("cache --json", ("analyze", "cache", "--list", "--json"), cache=OWN_CACHE),
        Verb("cache --clear", ("analyze", "cache", "--clear"), cache=OWN_CACHE),
    )
    entries = sorted(
        (path for path in (place / OWN_CACHE).rglob("*") if path.is_file() and path.stat().st_size),
        key=os.path.getsize,
    )
    return [
        Target(f"kept result {number}", place, str(path.relative_to(place)), verbs, replaceable=True)
        for number, path in enumerate((entries[0], entries[-1]), 1)
    ]


def _reproduced(folder: Path) -> list[Target]:
    """Published tosses, plain and packed, impacts, and the record of a virtual session."""
    place = folder / "reproduced"
    (place / "out" / "sessions").mkdir(parents=True, exist_ok=True)
    motions = [
        motion
        for way, number in (("air", 12), ("edge", 20), ("corner", 50))
        for motion in tossed(CUBE, number, 1, way)
    ]
    columns = write_tosses(place / "plain.npz", motions)
    with np.load(columns) as plain:
        np.savez_compressed(place / "packed.npz", **plain)
    record = session_record(*theta_session("carton", 1, 9), ThetaSource.SIMULATED, Sweeps((0.0,)))
    kept = place / "out" / "sessions" / f"{record.name}.json"
    kept.write_text(sealed_json(record), encoding="utf-8")
    tosses = (Verb("cube-tosses", ("analyze", "reproduce", "cube-tosses", "--data", "{file}", "--json")),)
    write_impacts(place / "impacts.mat", impacts())
    hits = (Verb("planar-impacts", ("analyze", "reproduce", "planar-impacts", "{file}", "--json")),)
    page = (Verb("paper", ("analyze", "reproduce", "paper", "-o", "out"), usual_s=3.0),)
    return [
        Target("tosses", place, "plain.npz", tosses),
        Target("tosses, packed", place, "packed.npz", tosses),
        Target("impacts", place, "impacts.mat", hits),
        Target("record of a session", place, str(kept.relative_to(place)), page, text=True),
    ]


def _virtual(folder: Path) -> list[Target]:
    """A user's object and its hidden masses, as `acquire virtual` and `acquire demo` read them."""
    place = folder / "virtual"
    place.mkdir(exist_ok=True)
    for name in ("teabox.toml", "teabox-truth.toml"):
        shutil.copy(ROOT / "docs" / "examples" / name, place / name)
    given = ("--object", "teabox.toml", "--truth", "teabox-truth.toml", "--dir", "new")
    verbs = (Verb("virtual", ("acquire", "virtual", *given), usual_s=3.0),)
    return [
        Target("virtual object", place, "teabox.toml", verbs, text=True),
        Target("truth of a virtual object", place, "teabox-truth.toml", verbs, text=True),
    ]


def _copied(recordings: Path, place: Path) -> Path:
    place.mkdir(exist_ok=True)
    shutil.copy(recordings / "quick.mcap", place / "quick.mcap")
    return place
