"""Files that are attacked, and the commands that read each kind of them."""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import cv2
import numpy as np
import tomlkit
import trimesh
from mcap.writer import Writer

from acquire.cli import main as acquire
from acquire.virtual import devices
from analyze.cli import main as analyze
from analyze.reading.recording import Recording, open_recording
from schemas.document import canonical_json
from tests import small_recording as small
from tests.attack.forked import run_forked
from tests.quick_archive import body_of, quick_session
from tests.system.complaints import spec_and_plan

LENS = """[camera.calibration]
width = 160
height = 120
K = [[350.0, 0.0, 79.5], [0.0, 350.0, 59.5], [0.0, 0.0, 1.0]]
T_world_camera = [[1, 0, 0, 0.03], [0, 0, 1, -0.55], [0, -1, 0, 0.08], [0, 0, 0, 1]]
"""
MESH_OBJECT = """\
name = "thing"
mass_kg = 0.3
mass_sd_kg = 0.001

[shape]
file = "{name}"
unit = "m"

[[marker]]
id = 1
size_m = 0.03
T_object_marker = [[0, 0, 1, 0.04], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]
"""


@dataclass(frozen=True)
class Verb:
    """A command line that reads the attacked file; `{file}` stands for its name."""

    name: str
    arguments: tuple[str, ...]
    same: bool = False
    """True if a result of the damaged file must be that of the whole one, unless it states a loss"""
    usual_s: float = 0.1
    """time that it usually takes [s]"""
    cache: str = ""
    """folder of kept results in the working folder; "" for the one common to all commands"""

    def call(self, file: str) -> Callable[[], object]:
        """Function that runs the command in the working folder."""
        arguments = [each.replace("{file}", file) for each in self.arguments]
        if arguments[0] == "read":
            return lambda: sys.stdout.write(read_all(Path(arguments[1])))
        command = acquire if arguments[0] == "acquire" else analyze

        def run() -> None:
            if self.cache:
                os.environ["XDG_CACHE_HOME"] = str(Path.cwd() / self.cache)
            if arguments[:2] == ["acquire", "virtual"]:
                devices.Devices.world = _interrupted  # in a process of its own
            command.main(arguments[1:], prog_name=arguments[0])

        return run


def _interrupted(*_: object) -> NoReturn:
    """End a rehearsal as Ctrl-C does, when its files are read and its devices would start."""
    raise KeyboardInterrupt


@dataclass(frozen=True)
class Target:
    """A kind of file: its folder with everything that its commands need, and the commands."""

    kind: str
    folder: Path
    """folder with the whole file and those that are read beside it"""
    file: str
    """name of the file that is attacked"""
    verbs: tuple[Verb, ...]
    text: bool = False
    """True for a file of text"""
    replaceable: bool = False
    """True for a file of the program's own, which commands may replace or remove"""


def read_all(path: Path) -> str:
    """Everything that an analysis takes from a recording, as JSON: hashes of head and messages, and losses.

    Raises:
        RecordingError: the recording is damaged.
    """
    from analyze.errors import AnalyzeError

    try:
        with open_recording(path) as recording:
            return json.dumps(_contents(recording))
    except AnalyzeError as error:
        raise SystemExit(f"analyze: {error}") from None


def _contents(recording: Recording) -> dict[str, object]:
    found: dict[str, object] = {"manifest": _sha(canonical_json(recording.manifest).encode())}
    found["attachments"] = {name: _sha(data) for name, data in recording.attachments.items()}
    for topic in recording.topics():
        digest = hashlib.sha256(recording.times(topic.name).tobytes())
        for message in recording.messages(topic.name):
            digest.update(b"%d %d " % (message.log_time_ns, message.sequence))
            digest.update(message.data)
        found[topic.name] = [topic.schema, digest.hexdigest()]
    found["losses"] = list(recording.recovery_losses)
    return found


def _sha(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


RECORDING_VERBS = (
    Verb("read", ("read", "{file}"), same=True),
    Verb("inspect", ("analyze", "inspect", "{file}")),
    Verb("inspect --json", ("analyze", "inspect", "--json", "{file}")),
    Verb("recover", ("acquire", "recover", "{file}", "-o", "new.mcap", "--json"), same=True),
    Verb("estimate", ("analyze", "estimate", "{file}", "--json", "--no-cache"), same=True, usual_s=2.0),
    Verb("report", ("analyze", "report", "{file}", "-o", "new.html", "--no-cache"), usual_s=4.0),
    Verb("replay", ("analyze", "replay", "{file}", "--save", "new.rrd", "--no-cache"), usual_s=3.0),
    Verb(
        "export",
        ("analyze", "export", "{file}", "--format", "urdf", "-o", "new.urdf", "--no-cache"),
        usual_s=2.0,
    ),
    Verb("register", ("analyze", "register", "{file}", "-o", "new.toml"), usual_s=2.0),
    Verb("rebase", ("analyze", "rebase", "{file}", "--object", "other.toml", "-o", "new.mcap")),
    Verb("gravity", ("analyze", "gravity", "{file}"), usual_s=1.0),
    Verb("score", ("analyze", "score", "{file}")),
    Verb("frame-rate", ("analyze", "frame-rate", "{file}", "--marker-size-mm", "30"), usual_s=1.0),
    Verb("calibrate", ("analyze", "calibrate", "{file}", "-o", "new.toml"), usual_s=1.0),
    Verb("import", ("analyze", "import", "{file}", "--object", "other.toml", "-o", "new.mcap")),
    Verb(
        "plan --given", ("analyze", "plan", "other.toml", "--given", "{file}", "-o", "new.json"), usual_s=1.0
    ),
    Verb("batch", ("analyze", "batch", "{file}", "--out", "results", "-j", "1"), usual_s=3.5),
    Verb("watch", ("analyze", "watch", "{file}")),
)
OBJECT_VERBS = (
    Verb("shape", ("analyze", "shape", "{file}")),
    Verb("shape --json", ("analyze", "shape", "{file}", "--json")),
    Verb("parts", ("analyze", "parts", "{file}")),
    Verb("plan", ("analyze", "plan", "{file}", "-o", "new.json", "--strikes", "3", "--no-cards")),
    Verb("fixture", ("analyze", "fixture", "{file}", "-o", "held.toml"), usual_s=5.0),
    Verb("print-tags", ("analyze", "print-tags", "--object", "{file}", "-o", "new.pdf"), usual_s=0.5),
    Verb("rebase", ("analyze", "rebase", "quick.mcap", "--object", "{file}", "-o", "new.mcap")),
    Verb("estimate", ("analyze", "estimate", "quick.mcap", "--object", "{file}", "--no-cache")),
    Verb("session", ("acquire", "session", "{file}", "plan.json", "-o", "new.mcap", "--rig", "rig.toml")),
)
SHAPE_VERBS = (
    Verb("shape", ("analyze", "shape", "object.toml")),
    Verb("parts", ("analyze", "parts", "object.toml")),
    Verb("plan", ("analyze", "plan", "object.toml", "-o", "new.json", "--strikes", "3", "--no-cards")),
)


def make_targets(folder: Path) -> list[Target]:
    """Write whole files of every kind below `folder`; returns what is to be attacked."""
    folder.mkdir(parents=True, exist_ok=True)
    tiny = _folder(folder, "small")
    small.write_recording(tiny / "a.mcap")
    quick = _folder(folder, "quick")
    quick_session(quick / "quick.mcap", body_of(1), 1)
    with open_recording(quick / "quick.mcap") as recording:
        spec = recording.object_spec
    own = tomlkit.dumps(spec.model_dump(mode="json", exclude_none=True, exclude_defaults=True))
    _write(quick, "other.toml", own)
    _write(tiny, "other.toml", spec_and_plan()[0])
    found = [
        Target("recording (small)", tiny, "a.mcap", RECORDING_VERBS),
        Target("recording", quick, "quick.mcap", RECORDING_VERBS),
    ]
    texts = _folder(folder, "texts")
    (texts / "quick.mcap").write_bytes((quick / "quick.mcap").read_bytes())
    toml, own_plan = spec_and_plan()
    _write(texts, "object.toml", toml)
    _write(texts, "plan.json", canonical_json(own_plan))
    _write(texts, "rig.toml", _rig(texts))
    _write(texts, "quick.toml", own)
    _write(texts, "times.csv", "name,time_s\n" + "".join(f"i{n}.png,{n / 120:.6f}\n" for n in range(12)))
    images = texts / "images"
    images.mkdir(exist_ok=True)
    for number in range(12):
        cv2.imwrite(str(images / f"i{number}.png"), _picture(number))
    found += [
        Target("object file", texts, "object.toml", OBJECT_VERBS, text=True),
        Target("plan", texts, "plan.json", _plan_verbs(), text=True),
        Target("rig file", texts, "rig.toml", _rig_verbs(), text=True),
        Target("times", texts, "times.csv", _times_verbs(), text=True),
        Target("image", texts, "images/i0.png", _image_verbs()),
    ]
    result = run_forked(
        Verb("", ("analyze", "estimate", "quick.mcap", "--json", "--no-cache")).call(""), texts, folder
    )
    _write(texts, "result.json", result.output)
    found.append(Target("result", texts, "result.json", _result_verbs(), text=True))
    found += [_shape(folder, kind) for kind in ("stl", "ascii.stl", "obj", "ply", "xyz", "glb", "3mf")]
    found += [_video(folder, texts), _foreign(folder, texts)]
    return found


def _folder(folder: Path, name: str) -> Path:
    (folder / name).mkdir(exist_ok=True)
    return folder / name


def _write(folder: Path, name: str, text: str) -> None:
    (folder / name).write_text(text, encoding="utf-8")


def _rig(folder: Path) -> str:
    return (
        f'[camera]\naddress = "127.9.9.9"\nframe_rate_hz = 120\n{LENS}\n[striker]\nkind = "manual"\n'
        f'[daemon]\nsocket = "{folder}/none.sock"\n'
    )


def _picture(number: int) -> np.ndarray:
    x, y = np.meshgrid(np.arange(160), np.arange(120))
    picture = (90 + x // 4 + y // 3).astype(np.uint8)
    tag = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100), 3, 35)
    picture[40:75, 50 + number : 85 + number] = np.minimum(tag, 200) + 20
    return picture


def _plan_verbs() -> tuple[Verb, ...]:
    imported = ("analyze", "import", "images", "--object", "object.toml", "--plan", "{file}", "--whole")
    return (
        Verb(
            "session", ("acquire", "session", "object.toml", "{file}", "-o", "new.mcap", "--rig", "rig.toml")
        ),
        Verb(
            "import", (*imported, "--camera", "rig.toml", "--times", "times.csv", "-o", "new.mcap", "--yes")
        ),
        Verb("strike", ("acquire", "strike", "--plan", "{file}", "--strike", "s1", "--rig", "rig.toml")),
    )


def _rig_verbs() -> tuple[Verb, ...]:
    return (
        Verb("plan --rig", ("analyze", "plan", "object.toml", "--rig", "{file}", "--strikes", "3")),
        Verb("plan --camera", ("analyze", "plan", "object.toml", "--camera", "{file}", "--strikes", "3")),
        Verb("status", ("acquire", "status", "--rig", "{file}")),
        Verb("stop", ("acquire", "stop", "--rig", "{file}")),
        Verb("check", ("acquire", "check", "{file}"), usual_s=3.0),
        Verb("run", ("acquire", "run", "{file}"), usual_s=3.0),
        Verb("strike --calibrate", ("acquire", "strike", "--calibrate", "--rig", "{file}", "--yes")),
    )


def _times_verbs() -> tuple[Verb, ...]:
    given = ("--object", "object.toml", "--plan", "plan.json", "--camera", "rig.toml")
    return (
        Verb(
            "import --times", ("analyze", "import", "images", *given, "--times", "{file}", "-o", "new.mcap")
        ),
    )


def _image_verbs() -> tuple[Verb, ...]:
    given = ("--object", "object.toml", "--plan", "plan.json", "--camera", "rig.toml")
    return (
        Verb("calibrate", ("analyze", "calibrate", "{file}", "images/i1.png", "-o", "new.toml")),
        Verb("gravity", ("analyze", "gravity", "{file}", "--rig", "rig.toml")),
        Verb("import", ("analyze", "import", "images", *given, "--times", "times.csv", "-o", "new.mcap")),
    )


def _result_verbs() -> tuple[Verb, ...]:
    return (
        Verb(
            "export",
            ("analyze", "export", "{file}", "--object", "quick.toml", "--format", "mjcf", "-o", "new.xml"),
        ),
        Verb(
            "export usd",
            ("analyze", "export", "{file}", "--object", "quick.toml", "--format", "usd", "-o", "new.usda"),
        ),
        Verb("plan --given", ("analyze", "plan", "quick.toml", "--given", "{file}", "--strikes", "1")),
    )


def _shape(folder: Path, kind: str) -> Target:
    place = _folder(folder, f"shape-{kind}")
    size = 1000.0 if kind == "3mf" else 1.0
    body = trimesh.creation.box((0.08 * size, 0.06 * size, 0.15 * size))
    if kind == "glb":
        body = trimesh.creation.cylinder(0.04, 0.12)
    name = f"thing.{kind}"
    if kind == "xyz":
        points, _ = trimesh.sample.sample_surface(body, 4000, seed=1)
        data = "".join(f"{x:.5f} {y:.5f} {z:.5f}\n" for x, y, z in points)
    else:
        data = body.export(file_type="stl_ascii" if kind == "ascii.stl" else kind)
    (place / name).write_bytes(data.encode() if isinstance(data, str) else data)
    text = MESH_OBJECT.replace("{name}", name)
    _write(place, "object.toml", text.replace('"m"', '"mm"') if kind == "3mf" else text)
    return Target(f"shape {kind}", place, name, SHAPE_VERBS, text=kind in {"ascii.stl", "obj", "xyz"})


def _video(folder: Path, texts: Path) -> Target:
    place = _folder(folder, "video")
    for name in ("object.toml", "plan.json", "rig.toml"):
        (place / name).write_bytes((texts / name).read_bytes())
    writer = cv2.VideoWriter(str(place / "v.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 60.0, (160, 120))
    for number in range(30):
        writer.write(cv2.cvtColor(_picture(number % 3), cv2.COLOR_GRAY2BGR))
    writer.release()
    given = ("--object", "object.toml", "--plan", "plan.json", "--camera", "rig.toml", "-o", "new.mcap")
    verbs = (
        Verb("import", ("analyze", "import", "{file}", *given, "--yes")),
        Verb("import --whole", ("analyze", "import", "{file}", *given, "--whole", "--strike", "s1")),
        Verb("frame-rate", ("analyze", "frame-rate", "{file}", "--marker-size-mm", "30")),
    )
    return Target("video", place, "v.mp4", verbs)


def _foreign(folder: Path, texts: Path) -> Target:
    """MCAP file of another program, compressed, with JSON messages."""
    place = _folder(folder, "foreign")
    for name in ("object.toml", "plan.json", "rig.toml"):
        (place / name).write_bytes((texts / name).read_bytes())
    with (place / "f.mcap").open("wb") as file:
        writer = Writer(file, chunk_size=2000)
        writer.start()
        schema = writer.register_schema("T", "jsonschema", b"{}")
        channel = writer.register_channel("/a", "json", schema)
        for number in range(200):
            writer.add_message(channel, number, json.dumps({"n": number}).encode(), number, number)
        writer.finish()
    given = ("--object", "object.toml", "--plan", "plan.json", "--camera", "rig.toml", "-o", "new.mcap")
    verbs = (
        Verb("inspect", ("analyze", "inspect", "{file}")),
        Verb("import --topic", ("analyze", "import", "{file}", "--topic", "/a", *given)),
        Verb("recover", ("acquire", "recover", "{file}", "-o", "new.mcap")),
    )
    return Target("MCAP of others", place, "f.mcap", verbs)
