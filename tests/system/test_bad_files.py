"""Errors in input files: one line with problem and remedy, exit code 1, no file left behind."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from acquire.cli import main as acquire
from acquire.recorder.image import RawImageEncoder
from analyze.cli import main as analyze
from schemas import topics
from schemas.document import canonical_json, sha256_text
from schemas.object_spec import object_sha256, parse_object_spec
from schemas.output_file import OutputError, write_text
from schemas.proto import percuss_pb2 as pb
from schemas.session_manifest import MANIFEST_NAME, CameraCalibrationSpec, ManifestCamera
from schemas.strike_plan import StrikePlan
from tests import small_recording
from tests.analyze.motion.tipping import SIZE, camera, marker, marker_poses, simulate
from tests.analyze.tracking.rendering import render
from tests.carton import CARTON
from tests.mcap_writer import McapWriter
from tests.places import OBJECTS
from tests.system.complaints import complaint, names_in, spec_and_plan, write

pytestmark = pytest.mark.usefixtures("nothing_left")

MESH = CARTON.replace("box = { size_m = [0.08, 0.06, 0.15] }", 'file = "body.stl"\nunit = "mm"')
JUICE_STL = (OBJECTS / "juice.stl").read_bytes()


# --- object, mesh, rig and plan files ---


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (
            "shell_thickness_m",
            "wall_thickness_m",
            r"unknown key 'wall_thickness_m': remove it or correct its spelling",
        ),
        ("mass_sd_kg", "mass_sdkg", r"unknown key 'mass_sdkg'"),
        ("0.044", "44", r"mass_kg: 44 kg is too heavy .* in kilograms \(44 g would be 0.044\)"),
        ("0.044", "15", r"20.*e\+04 kg/m3.*correct mass_kg \(in kilograms\)|2.08e\+04 kg/m3"),
        ("0.0001", "0.1", r"mass_sd_kg must be below mass_kg: .* in kilograms"),
        ("0.0001", "nan", r"mass_sd_kg: .*finite"),
        ("[0.08, 0.06, 0.15]", "[80, 60, 150]", r"give box and cylinder in metres"),
        ("0.0025", "2.5", r"shell_thickness_m: 2.5 m .* \(2.5 mm would be 0.0025\)"),
        ("edge_radius_m = 0.001", "edge_radius_m = 1.0", r"edge_radius_m: 1 m .* in metres"),
        ("0.04]", "40]", r"T_object_marker: its translation is 40 m: translations are in metres"),
        ("[1, 0, 0, 0]", "[2, 0, 0, 0]", r"T_object_marker: .* not a rotation"),
        ("[1, 0, 0, 0]", "[-1, 0, 0, 0]", r"T_object_marker: .* right-handed"),
        ("[0, 0, 0, 1]", "[0, 0, 0, 2]", r"T_object_marker: its last row"),
        ("id = 3", "id = 900", r"marker.0.id: .* 586"),
        ("name =", "name", r"not valid TOML"),
        ("name =", "deep = " + "[" * 5000 + "\nname =", r"nested too deeply|not valid TOML"),
    ],
)
def test_an_object_file_with_a_mistake(tmp_path: Path, old: str, new: str, says: str) -> None:
    path = write(tmp_path / "object.toml", CARTON.replace(old, new, 1))
    line = complaint(analyze, "plan", path, "-o", tmp_path / "plan.json")
    assert re.search(says, line)
    assert names_in(tmp_path) == {"object.toml"}


@pytest.mark.parametrize(
    ("toml", "mesh", "says"),
    [
        (MESH.replace('unit = "mm"\n', ""), JUICE_STL, r"needs its unit: unit = \"mm\""),
        (MESH.replace('"mm"', '"m"'), JUICE_STL, r"body.stl: .* did you mean unit = \"mm\"\?"),
        (MESH.replace('"mm"', '"in"'), JUICE_STL, r"body.stl: .* did you mean unit = \"mm\"\?"),
        (
            MESH,
            JUICE_STL[:80] + (12).to_bytes(4, "little") + JUICE_STL[84 : 84 + 12 * 50],
            r"body.stl: not a closed body \(\d+ open edges.*: close",
        ),
        (MESH, JUICE_STL[:2000], r"body.stl: cannot be read as STL: .*export it anew"),
        (MESH, b"", r"body.stl: has no faces"),
        (MESH, None, r"body.stl: no such shape file: object.toml names it"),
        (MESH.replace("body.stl", "body.step"), JUICE_STL, r"body.step: no such shape file"),
    ],
)
def test_a_mesh_that_is_no_closed_body_of_known_size(
    tmp_path: Path, toml: str, mesh: bytes | None, says: str
) -> None:
    path = write(tmp_path / "object.toml", toml)
    if mesh is not None:
        write(tmp_path / "body.stl", mesh)
    assert re.search(says, complaint(analyze, "plan", path, "-o", tmp_path / "plan.json"))
    assert not (tmp_path / "plan.json").exists()


def test_a_path_that_is_not_an_object_file(tmp_path: Path) -> None:
    assert "none.toml: no such file: check the path" in complaint(analyze, "plan", tmp_path / "none.toml")
    assert "is not a text file" in complaint(
        analyze, "plan", write(tmp_path / "noise.toml", bytes(range(256)))
    )
    assert "Is a directory" in complaint(analyze, "plan", tmp_path)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (None, "no such rig file: check the path"),
        ("[camera]\naddress = '1'\n", r"missing: add \[camera.calibration\] \(.*docs/how-to/rig.md\)$"),
        ("camera = 5\n", r"camera: should be \[camera\] \(with address .*\), not 5$"),
        (
            "table_fricton = 0.6\n{calibration}",
            "unknown key 'table_fricton': remove it or correct its spelling",
        ),
        ("{calibration}[striker]\narm_lenght_m = 0.1\n", "unknown key 'striker.arm_lenght_m'"),
        ("rig : 1\n", "not valid TOML"),
        (
            "table_friction = -1\n{calibration}",
            "table_friction: should be at least 0.001 and at most 10, not -1",
        ),
        (
            "[camera]\naddress = '1'\nframe_rate_hz = " + 308 * "9" + "\n{calibration}",
            r"camera.frame_rate_hz: should be at least 0.01 and at most 100000.*, not 99999999.*308 digits",
        ),
        (
            "[striker]\neffective_mass_kg = nan\n{calibration}",
            r"striker.effective_mass_kg: Input should be .*finite",
        ),
        ("{calibration}\nfocus = 3\n", "unknown key 'camera.calibration.focus'"),
    ],
)
def test_a_rig_file_that_cannot_be_planned_with(tmp_path: Path, text: str | None, says: str) -> None:
    calibration = (
        "[camera.calibration]\nwidth = 656\nheight = 492\nK = [[1430, 0, 328], [0, 1430, 246], [0, 0, 1]]\n"
    )
    calibration += "T_world_camera = [[1, 0, 0, 0.03], [0, 0, 1, -0.55], [0, -1, 0, 0.08], [0, 0, 0, 1]]\n"
    path = tmp_path / "rig.toml"
    if text is not None:
        write(path, text.replace("{calibration}", calibration))
    line = complaint(analyze, "plan", write(tmp_path / "object.toml", CARTON), "--rig", path)
    assert re.search(says, line)
    assert "rig.toml" in line


def test_an_output_without_a_place(tmp_path: Path) -> None:
    thing = write(tmp_path / "object.toml", CARTON)
    assert "is also an input" in complaint(analyze, "plan", thing, "-o", thing)
    assert "create it first" in complaint(analyze, "plan", thing, "-o", tmp_path / "gone" / "p.json")
    assert "is a folder: name a file in it" in complaint(analyze, "plan", thing, "-o", tmp_path)
    with pytest.raises(OutputError, match=r"/proc/p.json: cannot be written: .*: choose another place"):
        write_text(Path("/proc/p.json"), "")
    assert thing.read_text() == CARTON
    assert names_in(tmp_path) == {"object.toml"}


# --- recordings ---


def record(
    path: Path,
    images: list[np.ndarray],
    *,
    toml: str = CARTON,
    plan: StrikePlan | None = None,
    strikes: int = 4,
    **manifest: object,
) -> Path:
    """Write a recording with `strikes` strikes, in whose windows (time spans) all of `images` lie."""
    plan = plan or spec_and_plan(toml)[1]
    plan_json = plan.model_dump_json()
    height, width = images[0].shape
    lens = camera()
    spec = parse_object_spec(toml, "object")
    calibration = CameraCalibrationSpec(
        width=width, height=height, K=lens.K.tolist(), T_world_camera=lens.T_world_camera.tolist()
    )
    known = {
        "object": spec,
        "object_sha256": object_sha256(spec, None),
        "plan_sha256": sha256_text(plan_json),
        "cameras": [
            ManifestCamera(name="main", frame_rate_hz=120.0, exposure_us=1500, calibration=calibration)
        ],
        "hashes": {"plan.json": sha256_text(plan_json)},
    }
    writer = McapWriter(path)
    writer.metadata(MANIFEST_NAME, {"json": canonical_json(small_recording.manifest(**known | manifest))})
    writer.attachment("plan.json", "application/json", plan_json.encode())
    encoder = RawImageEncoder("camera", width, height)
    raw, clock, strike = (
        writer.add_topic(topic)
        for topic in (topics.raw_image("main"), topics.CLOCK_SAMPLE, topics.SESSION_STRIKE)
    )
    start, last = small_recording.frame_time(0), small_recording.frame_time(len(images) - 1)
    writer.write(clock, start, pb.ClockSample(clock="camera/main").SerializeToString())
    for number, image in enumerate(images):
        time_ns = small_recording.frame_time(number)
        writer.write(raw, time_ns, encoder.encode(time_ns, image), sequence=number)
    for number in range(1, strikes + 1):
        message = pb.StrikeRecord(
            strike_id=f"s{number}.1", plan_strike_id=f"s{number}", window_start_ns=start, window_end_ns=last
        )
        writer.write(strike, last + number, message.SerializeToString())
    writer.finish()
    return path


BLANK = [np.full((64, 96), 120, np.uint8)] * 3


@pytest.fixture(scope="module")
def scenes() -> dict[str, list[np.ndarray]]:
    """Images of a resting tag: alone, and beside another one with the same id."""
    rng = np.random.default_rng(0)
    R, p = marker_poses(simulate(1.0, length=0.02), marker())
    one = (3, SIZE, R[0], p[0])
    other = (3, SIZE, R[0], p[0] + np.array([0.05, 0.0, 0.0]))
    return {"one": [render(camera(), [one], rng)] * 3, "twice": [render(camera(), [one, other], rng)] * 3}


@pytest.mark.parametrize("verb", ["inspect", "estimate", "score", "report", "replay", "watch"])
def test_a_path_that_is_not_a_recording(tmp_path: Path, verb: str) -> None:
    before = {write(tmp_path / "noise.mcap", bytes(range(256))).name}
    assert "none.mcap: no such recording: check the path" in complaint(analyze, verb, tmp_path / "none.mcap")
    assert "noise.mcap: is not a recording: it does not begin like an MCAP file" in complaint(
        analyze, verb, tmp_path / "noise.mcap"
    )
    assert "is a folder, not a recording: name a file in it, as noise.mcap" in complaint(
        analyze, verb, tmp_path
    )
    assert names_in(tmp_path) == before


@pytest.mark.parametrize("verb", ["estimate", "score", "report"])
@pytest.mark.parametrize("name", ["cut.mcap", "cut.mcap.part"])
def test_a_recording_that_is_cut_short(tmp_path: Path, verb: str, name: str) -> None:
    whole = record(tmp_path / "whole.mcap", BLANK).read_bytes()
    cut = write(tmp_path / name, whole[: len(whole) // 2])
    assert f"{name}: ends early: it was cut short or is still being written: `acquire recover" in complaint(
        analyze, verb, cut
    )
    empty = write(tmp_path / "empty.mcap", b"")
    assert "empty.mcap: is empty" in complaint(analyze, verb, empty)
    cut.unlink()
    assert names_in(tmp_path) == {"whole.mcap", "empty.mcap"}


@pytest.mark.parametrize("verb", ["inspect", "estimate", "score", "report", "replay", "watch"])
def test_a_recording_of_another_major_schema(tmp_path: Path, verb: str) -> None:
    path = record(tmp_path / "new.mcap", BLANK, schema_version="2.3")
    assert (
        "new.mcap: has schema version 2.3, this program reads 1.x: use a version of Percuss that writes 2.x"
        in complaint(analyze, verb, path)
    )


def test_a_newer_minor_schema_is_read(tmp_path: Path) -> None:
    path = record(tmp_path / "new.mcap", BLANK, schema_version="1.7")
    assert CliRunner().invoke(analyze, ["inspect", str(path)]).exit_code == 0


def test_recover_refuses_what_it_cannot_save_and_what_exists(tmp_path: Path) -> None:
    whole = record(tmp_path / "whole.mcap", BLANK)
    assert "is also an input and would be replaced" in complaint(acquire, "recover", whole, "-o", whole)
    taken = write(tmp_path / "taken.mcap", b"taken")
    assert "exists already" in complaint(acquire, "recover", whole, "-o", taken)
    assert "no such recording: check the path" in complaint(acquire, "recover", tmp_path / "none.mcap")
    for folder in (".", "..", "/", tmp_path):
        assert f"{folder}: is a folder: name the recording in it" in complaint(acquire, "recover", folder)
        assert f"{folder}: is a folder: name the recording in it" in complaint(
            acquire, "recover", folder, "-o", tmp_path / "new.mcap"
        )
    assert "is empty" in complaint(acquire, "recover", write(tmp_path / "empty.mcap", b""))
    assert "is not a recording" in complaint(acquire, "recover", write(tmp_path / "noise.mcap", bytes(99)))
    assert "nothing can be saved" in complaint(
        acquire, "recover", write(tmp_path / "head.mcap", whole.read_bytes()[:30])
    )
    assert "create it first" in complaint(acquire, "recover", whole, "-o", tmp_path / "gone" / "new.mcap")
    assert "is a folder: name a file in it" in complaint(acquire, "recover", whole, "-o", tmp_path)
    assert names_in(tmp_path) == {"whole.mcap", "taken.mcap", "empty.mcap", "noise.mcap", "head.mcap"}


@pytest.mark.parametrize("verb", ["estimate", "report"])
def test_a_plan_of_another_object(tmp_path: Path, verb: str) -> None:
    path = record(tmp_path / "r.mcap", BLANK, plan=spec_and_plan(object_sha256="0" * 64)[1])
    assert re.search(
        r"r.mcap: its plan is of another object .*plan this object and record again",
        complaint(analyze, verb, path),
    )


def test_too_few_good_strikes(tmp_path: Path) -> None:
    path = record(tmp_path / "r.mcap", BLANK)
    assert re.search(
        r"r.mcap: 0 good strikes of 4, 3 are needed \(not usable: s1.1 marker lost.*strike again",
        complaint(analyze, "estimate", path),
    )
    excluded = [f"--exclude=s{number}.1" for number in (1, 2)]
    line = complaint(analyze, "estimate", path, *excluded)
    assert (
        "(excluded on request: s1.1, s2.1; not usable: s3.1 marker lost, s4.1 marker lost): strike again"
        in line
    )
    line = complaint(analyze, "estimate", path, "--exclude", "s9.1")
    assert "no strike 's9.1' to exclude: its strikes are s1.1, s2.1, s3.1, s4.1" in line
    assert "0 good strikes of 0" in complaint(
        analyze, "estimate", record(tmp_path / "none.mcap", BLANK, strikes=0)
    )


def test_a_tag_that_is_unknown_or_seen_twice(tmp_path: Path, scenes: dict[str, list[np.ndarray]]) -> None:
    strange = record(tmp_path / "strange.mcap", scenes["one"], toml=CARTON.replace("id = 3", "id = 7"))
    line = complaint(analyze, "estimate", strange)
    assert (
        "strange.mcap: marker 3 is in view, but the object carries 7: correct the object file or the marker"
        in line
    )
    twice = record(tmp_path / "twice.mcap", scenes["twice"])
    assert "twice.mcap: marker 3 is in view twice: cover or remove one" in complaint(
        analyze, "estimate", twice
    )


def test_an_object_file_of_another_shape_given_afterwards(tmp_path: Path) -> None:
    path = record(tmp_path / "r.mcap", BLANK)
    other = write(tmp_path / "other.toml", CARTON.replace("0.15]", "0.08]"))
    line = complaint(analyze, "estimate", path, "--object", other)
    assert re.search(
        r"other.toml: is of another shape than .*r.mcap: .* mm off its surface, more than .* mm: "
        r"give a corrected file",
        line,
    )
    corrected = write(
        tmp_path / "corrected.toml", CARTON.replace("0.044", "0.045").replace("0.15]", "0.151]")
    )
    assert "good strikes" in complaint(analyze, "estimate", path, "--object", corrected)
    assert "gone.toml: no such file" in complaint(
        analyze, "estimate", path, "--object", tmp_path / "gone.toml"
    )


def test_no_truth_to_score_against(tmp_path: Path) -> None:
    assert "holds no ground truth: only recordings of the virtual rig" in complaint(
        analyze, "score", record(tmp_path / "r.mcap", BLANK)
    )


@pytest.mark.parametrize(
    ("verb", "option"), [("report", "-o"), ("replay", "--save"), ("replay", "--screenshot")]
)
def test_a_recording_is_never_written_over(tmp_path: Path, verb: str, option: str) -> None:
    path = record(tmp_path / "r.mcap", BLANK)
    before = path.read_bytes()
    assert "is also an input" in complaint(analyze, verb, path, option, path)
    assert "create it first" in complaint(analyze, verb, path, option, tmp_path / "gone" / "out")
    assert path.read_bytes() == before
