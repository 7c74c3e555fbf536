"""Check of an error message: one line, exit code 1, no file left behind."""

from __future__ import annotations

from pathlib import Path

from click.testing import CliRunner

from schemas.object_spec import object_sha256, parse_object_spec
from schemas.strike_plan import StrikePlan
from tests.analyze.motion.tipping import planned
from tests.carton import CARTON


def complaint(command, *arguments: object) -> str:
    """Run a command that must fail; return its one line on standard error."""
    result = CliRunner().invoke(command, [str(argument) for argument in arguments])
    assert result.exit_code == 1, (result.output, result.exception)
    assert result.stdout == ""
    assert result.exception is None or isinstance(result.exception, SystemExit)
    return one_line(result.stderr)


def one_line(text: str) -> str:
    assert "Traceback" not in text
    (line,) = text.splitlines()
    assert line.startswith(("acquire: ", "analyze: "))
    return line


def names_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def write(path: Path, data: str | bytes) -> Path:
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    return path


def spec_and_plan(toml: str = CARTON, **changes: object) -> tuple[str, StrikePlan]:
    digest = object_sha256(parse_object_spec(toml, "object"), None)
    strikes = [planned().model_copy(update={"id": f"s{number}", "pivot": pivot()}) for number in range(1, 5)]
    known = {"object_name": "carton", "object_sha256": digest, "strikes": strikes}
    return toml, StrikePlan.model_validate(known | changes)


def pivot():
    return planned().pivot.model_copy(update={"point": [0.039, 0.0, -0.074], "radius_m": 0.001})
