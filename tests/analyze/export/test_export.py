"""`analyze export` from a recording or a result: files, messages and refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from analyze.cli import main as analyze
from analyze.errors import ExportError
from analyze.export import read_back as readers
from analyze.export.body import inertial_of
from analyze.export.formats import Format
from analyze.export.measured_only import refuse_prior
from analyze.export.provenance import prior_entries, provenance
from analyze.export.read_back import read_back
from analyze.export.write import refuse_changed_parameters
from analyze.reading.object_file import read_object_files
from analyze.reading.recording import open_recording
from analyze.types import TENSOR_ENTRIES
from schemas.result import Result
from tests.analyze.export.bodies import model_of, spec_of, wedge_obj
from tests.places import SAMPLE


def run(*arguments: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(analyze, [str(each) for each in arguments], catch_exceptions=False)
    return done.exit_code, done.stdout, done.stderr


def line_of(*arguments: object) -> str:
    """Error message, one line, of an export command that is refused with exit code 1."""
    code, _, error = run(*arguments)
    assert code == 1, error
    assert error.count("\n") == 1, error
    return error


@pytest.fixture(scope="module")
def answered(tmp_path_factory) -> Path:
    """Folder with the output of `estimate --json` for the sample recording, and its object file."""
    folder = tmp_path_factory.mktemp("answered")
    code, out, error = run("estimate", SAMPLE, "--json")
    assert code == 0, error
    (folder / "result.json").write_text(out, encoding="utf-8")
    with open_recording(SAMPLE) as recording:
        (folder / "object.toml").write_bytes(recording.attachments["object.toml"])
    return folder


@pytest.fixture(scope="module")
def result(answered) -> Result:
    """Result of the sample recording, with moments about x, y and z."""
    return Result.model_validate_json((answered / "result.json").read_text())


def test_export_from_a_recording(answered, tmp_path):
    path = tmp_path / "carton.urdf"
    code, out, error = run("export", SAMPLE, "--format", "urdf", "-o", path)
    assert (code, out) == (0, f"URDF: {path}; read back: the same ten parameters\n")
    assert "from the shape, not from strikes: Ixy, Ixz, Iyz" in error
    wanted = inertial_of(Result.model_validate_json((answered / "result.json").read_text()), "result")
    refuse_changed_parameters(wanted, read_back(path, Format.URDF), Format.URDF)


@pytest.mark.parametrize(
    "wanted", [each for each in Format if each is not Format.GAZEBO], ids=lambda each: each.value
)
def test_export_from_a_result_in_every_format(answered, wanted, tmp_path):
    path = tmp_path / f"carton{wanted.suffixes[0]}"
    files = answered / "result.json", "--object", answered / "object.toml"
    code, out, error = run("export", *files, "--format", wanted.value, "-o", path)
    assert code == 0, error
    assert "the same ten parameters" in out
    stated = Result.model_validate_json(files[0].read_text())
    refuse_changed_parameters(inertial_of(stated, "result"), read_back(path, wanted), wanted)
    assert stated.inputs.content_id in path.read_text()
    once = path.read_bytes()
    assert run("export", *files, "--format", wanted.value, "-o", path)[0] == 0
    assert path.read_bytes() == once


def test_measured_only_names_prior_entries_and_edges_that_would_measure_them(answered, tmp_path):
    path = tmp_path / "carton.urdf"
    files = answered / "result.json", "--object", answered / "object.toml"
    error = line_of("export", *files, "--format", "urdf", "-o", path, "--measured-only")
    assert (
        "Ixy, Ixz, Iyz of the inertia are from the shape: no edge of this object would measure them" in error
    )
    assert not path.exists()


def with_inertia(result: Result, prior: list[str]) -> Result:
    """Copy of `result` in which only the entries named in `prior` (Ixx, Ixy, ...) come from the shape."""
    names = {f"I{'xyz'[min(i, j)]}{'xyz'[max(i, j)]}" for i in range(3) for j in range(3)}
    assert set(prior) <= names
    measured = [[f"I{'xyz'[min(i, j)]}{'xyz'[max(i, j)]}" not in prior for j in range(3)] for i in range(3)]
    inertia = result.inertia.model_copy(update={"observed": not prior})
    return result.model_copy(update={"inertia_measured": measured, "inertia": inertia})


def test_fully_measured_result_passes(result):
    refuse_prior(with_inertia(result, []), spec_of("box"), model_of("box"), "r.mcap")


@pytest.mark.parametrize(
    ("axes", "prior", "said"),
    [
        (
            "xy",
            ["Izz"],
            r"Izz of the inertia is from the shape: tips over edge \w+ \(along z\) would measure it",
        ),
        (
            "x",
            ["Iyy", "Izz", "Ixy"],
            (
                r"tips over edges \w+ \(along .\), \w+ \(along .\) would measure the rest, but no edge .* "
                r"determines Ixy"
            ),
        ),
        ("xyz", ["Iyz"], r"Iyz of the inertia is from the shape: no edge of this object would measure"),
    ],
)
def test_edges_of_a_box_that_would_measure_prior_entries(result, axes, prior, said):
    moments = [moment for moment in result.moments if "xyz"[int(np.argmax(np.abs(moment.direction)))] in axes]
    lacking = with_inertia(result, prior).model_copy(update={"moments": moments})
    with pytest.raises(ExportError, match=said):
        refuse_prior(lacking, spec_of("box"), model_of("box"), "r.mcap")


def test_lying_cylinder_never_determines_the_moment_about_its_axis(result):
    upright = [moment for moment in result.moments if abs(moment.direction[2]) < 0.1]
    lacking = with_inertia(result, ["Izz"]).model_copy(update={"moments": upright})
    with pytest.raises(
        ExportError, match=r"Izz of the inertia is from the shape: no edge of this object would measure them"
    ):
        refuse_prior(lacking, spec_of("cylinder"), model_of("cylinder"), "r.mcap")


def test_slanted_edge_measures_a_product_of_inertia(result):
    """The wedge has edges across x and y: one determines Ixy once Ixx and Iyy are known."""
    spec, model = spec_of("mesh"), model_of("mesh")
    with pytest.raises(
        ExportError,
        match=r"Ixy of the inertia is from the shape: tips over edge .*\(along \(.*\) would measure it: "
        r"plan with",
    ):
        refuse_prior(with_inertia(result, ["Ixy"]), spec, model, "r.mcap")


def test_unobserved_centre_of_mass_is_refused(result):
    com = result.centre_of_mass.model_copy(
        update={"observed": False, "unobserved_direction": [0.0, 0.6, -0.8]}
    )
    with pytest.raises(
        ExportError,
        match=r"no strike determines the centre of mass along \(0.00, -0.60, 0.80\): tip it over an edge "
        r"across",
    ):
        refuse_prior(
            result.model_copy(update={"centre_of_mass": com}), spec_of("box"), model_of("box"), "r.mcap"
        )


def test_older_result_without_inertia_measured_counts_as_prior(result):
    older = result.model_copy(update={"inertia_measured": None})
    assert prior_entries(older) == list(TENSOR_ENTRIES)


def test_file_states_which_numbers_are_measured(result):
    said = provenance(with_inertia(result, ["Ixy"]), "thing", "percuss 1")
    assert said["content_id"] == result.inputs.content_id
    sources = {name: entry["source"] for name, entry in said["inertia"].items()}
    assert sources == {
        name: "prior" if name == "Ixy" else "measured" for name in ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
    }
    assert all(entry["sd"] > 0 for entry in said["inertia"].values())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            lambda r: r.model_copy(update={"mass": r.mass.model_copy(update={"value": 0.0})}),
            "not physically possible",
        ),
        (
            lambda r: r.model_copy(
                update={"inertia": r.inertia.model_copy(update={"value": np.diag([1, 1, 3.0]).tolist()})}
            ),
            "not physically possible",
        ),
        (
            lambda r: r.model_copy(update={"inertia": r.inertia.model_copy(update={"value": None})}),
            "contains no inertia",
        ),
        (
            lambda r: r.model_copy(
                update={"centre_of_mass": r.centre_of_mass.model_copy(update={"value": [1.0]})}
            ),
            "three numbers",
        ),
    ],
)
def test_impossible_body_is_refused(result, change, said):
    with pytest.raises(ExportError, match=said):
        inertial_of(change(result), "result.json")


def test_a_result_needs_its_own_object_file(answered, tmp_path):
    out = "--format", "urdf", "-o", tmp_path / "a.urdf"
    assert "add --object" in line_of("export", answered / "result.json", *out)
    other = tmp_path / "other.toml"
    other.write_text(
        (answered / "object.toml").read_text().replace('name = "carton"', 'name = "other"'), encoding="utf-8"
    )
    assert "is not the object of" in line_of("export", answered / "result.json", "--object", other, *out)
    assert "--exclude does not apply to a result" in line_of(
        "export", answered / "result.json", "--object", other, "--exclude", "s1.1", *out
    )
    assert "must be the only file" in line_of("export", answered / "result.json", SAMPLE, *out)


@pytest.mark.parametrize(
    ("wanted", "name", "said"),
    [
        ("urdf", "a.sdf", "its suffix belongs to SDF, not to URDF: name it a.urdf"),
        ("usd", "a.out", "USD is recognised by its suffix"),
        ("mjcf", "a.usda", "its suffix belongs to USD, not to MJCF: name it a.xml"),
        ("urdf", "no/a.urdf", "there is no folder"),
    ],
)
def test_misleading_suffix_is_refused_before_the_estimate(wanted, name, said, tmp_path):
    assert said in line_of("export", SAMPLE, "--format", wanted, "-o", tmp_path / name)


def test_output_must_not_replace_the_recording(tmp_path):
    recording = tmp_path / "r.urdf"
    recording.write_bytes(SAMPLE.read_bytes())
    assert "is also an input" in line_of("export", recording, "--format", "urdf", "-o", recording)


def test_missing_reader_is_one_line_before_the_estimate(monkeypatch, tmp_path):
    monkeypatch.setitem(readers.READERS, Format.SDF, ("no_such_module", "rod"))
    error = line_of("export", SAMPLE, "--format", "sdf", "-o", tmp_path / "a.sdf")
    assert "rod: pip install '.[export]' in the project's folder" in error


def test_scanned_mesh_is_written_beside_the_file(answered, tmp_path):
    """The export is made on the command line, from a result of an object with a shape file."""
    stated = json.loads((answered / "result.json").read_text())
    (tmp_path / "wedge.obj").write_bytes(wedge_obj())
    shape = 'shape = {file = "wedge.obj", unit = "mm"}'
    toml = (
        f'name = "a/b & <c>"\nmass_kg = 0.3\nmass_sd_kg = 0.001\n{shape}\n[[marker]]\nid = 0\nsize_m = 0.03\n'
    )
    (tmp_path / "o.toml").write_text(toml, encoding="utf-8")
    stated["inputs"]["object_sha256"] = read_object_files(tmp_path / "o.toml").sha256
    (tmp_path / "r.json").write_text(json.dumps(stated), encoding="utf-8")
    code, out, error = run(
        "export",
        tmp_path / "r.json",
        "--object",
        tmp_path / "o.toml",
        "--format",
        "sdf",
        "-o",
        tmp_path / "x.sdf",
    )
    assert code == 0, error
    beside = next(tmp_path.glob("a_b_c-*.obj"))
    assert f"with {beside.name} beside it" in out
    assert read_back(tmp_path / "x.sdf", Format.SDF).mass == pytest.approx(stated["mass"]["value"], rel=1e-12)
