"""One rule for files that exist: recordings and settings are kept, all others are replaced."""

from __future__ import annotations

from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from acquire.errors import RecorderError
from acquire.recorder.atomic import publish, refuse_taken
from analyze.cli import main
from analyze.verbs.outputs import refuse_outputs
from schemas.output_file import OutputError, why_taken, write_text
from tests.places import FIRST_SAMPLE

SAMPLE = str(FIRST_SAMPLE)
WRITERS = {
    ("shape", "-o"): ["shape", "object.toml"],
    ("fixture", "-o"): ["fixture", "object.toml"],
    ("plan", "-o"): ["plan", "object.toml"],
    ("plan", "--rerun"): ["plan", "object.toml"],
    ("estimate", "--voxels"): ["estimate", SAMPLE],
    ("report", "-o"): ["report", SAMPLE],
    ("replay", "--save"): ["replay", SAMPLE],
    ("replay", "--screenshot"): ["replay", SAMPLE],
    ("replay", "--animation"): ["replay", SAMPLE],
    ("export", "-o"): ["export", SAMPLE, "--format", "urdf"],
    ("print-tags", "-o"): ["print-tags"],
    ("gravity", "--picture"): ["gravity", "a.png"],
    ("calibrate", "-o"): ["calibrate", "a.png"],
    ("calibrate", "--picture"): ["calibrate", "a.png"],
    ("register", "-o"): ["register", SAMPLE],
    ("rebase", "-o"): ["rebase", SAMPLE, "--object", "o.toml"],
    ("import", "-o"): ["import", "a.mp4", "--object", "o.toml", "--plan", "p.json"],
    ("query", "--save"): ["query", "select 1"],
    ("batch", "--save"): ["batch", "--summary"],
    ("archive list", "--save"): ["archive", "list"],
    ("archive object", "--save"): ["archive", "object", "carton"],
    ("reproduce cube-tosses", "--plot"): ["reproduce", "cube-tosses"],
}
"""a command line for each option that names a file to write, without that option"""
FORCED = {"calibrate", "fixture", "register", "rebase", "import"}
"""verbs with --force"""
READ = {
    "--object",
    "--rig",
    "--camera",
    "--given",
    "--table",
    "--mat",
    "--times",
    "--toss",
    "--plan",
    "--data",
}
FOLDERS = {"--out", "--csv"}
"""folders of results, whose files are replaced"""


def _path_options(command: click.Command, name: str = "") -> set[tuple[str, str]]:
    if isinstance(command, click.Group):
        return {
            each
            for verb, one in command.commands.items()
            for each in _path_options(one, f"{name} {verb}".strip())
        }
    options = (each for each in command.params if isinstance(each, click.Option))
    return {
        (name, short)
        for option in options
        if isinstance(option.type, click.Path) and option.type.file_okay
        for short in [option.opts[0]]
        if not {*option.opts} & (READ | FOLDERS)
    }


def test_every_option_that_names_a_file_to_write_is_checked_here() -> None:
    assert _path_options(main) == set(WRITERS)


@pytest.mark.parametrize("suffix", [".mcap", ".TOML"])
@pytest.mark.parametrize(("verb", "option"), WRITERS, ids=map(" ".join, WRITERS))
def test_existing_recording_or_settings_file_is_kept(
    tmp_path: Path, verb: str, option: str, suffix: str
) -> None:
    taken = tmp_path / f"taken{suffix}"
    taken.write_text("precious")
    done = CliRunner().invoke(main, [*WRITERS[verb, option], option, str(taken)])
    remedy = "choose another name" + (", or give --force to replace it" if verb in FORCED else "")
    assert done.output == f"analyze: {taken}: exists already: {remedy}\n"
    assert done.exit_code == 1
    assert taken.read_text() == "precious"


def test_force_replaces_what_is_kept_but_never_what_is_read(tmp_path: Path) -> None:
    kept, read, page = (tmp_path / name for name in ("old.toml", "in.toml", "page.html"))
    for path in (kept, read, page):
        path.write_text("old")
    refuse_outputs([kept, None], inputs=[read], force=True)
    refuse_outputs([page, tmp_path / "new.mcap"], inputs=[read])
    for outputs, force, message in (
        ([kept], False, "exists already"),
        ([kept], None, "exists already"),
        ([read], True, "is also an input"),
        ([page, kept], False, "exists already"),
    ):
        with pytest.raises(OutputError, match=message):
            refuse_outputs(outputs, inputs=[read], force=force)
    write_text(page, "new")
    assert page.read_text() == "new"


def test_both_commands_name_a_kept_file_alike(tmp_path: Path) -> None:
    taken = tmp_path / "taken.mcap"
    assert why_taken(taken, force=False) is None
    taken.touch()
    with pytest.raises(RecorderError) as refused:
        refuse_taken(taken, force=False)
    assert str(refused.value) == why_taken(taken, force=False)
    refuse_taken(taken, force=True)


def test_forced_recording_replaces_the_older_one_in_one_step(tmp_path: Path) -> None:
    part, path = tmp_path / "a.part", tmp_path / "a.mcap"
    part.write_text("new")
    path.write_text("old")
    with pytest.raises(RecorderError, match="another program created it"):
        publish(part, path)
    assert path.read_text() == "old"
    publish(part, path, replace=True)
    assert path.read_text() == "new"
    assert not part.exists()
