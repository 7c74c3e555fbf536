"""A problem is one line and an exit code, in both commands."""

from __future__ import annotations

import re

import click
import pytest
from click.testing import CliRunner

import acquire.cli
import analyze.cli
from schemas.command_line import INTERRUPTED, PROBLEM, NumberRange, one_line_errors
from schemas.document import DocumentError


class Mine(Exception):
    pass


@pytest.mark.parametrize(
    ("raised", "code", "line"),
    [
        (Mine("a thing: its remedy"), PROBLEM, "hit: a thing: its remedy\n"),
        (DocumentError("x.toml: unknown key"), PROBLEM, "hit: x.toml: unknown key\n"),
        (
            FileNotFoundError(2, "No such file", "x"),
            PROBLEM,
            "hit: x: No such file: check disk and permissions\n",
        ),
        (OSError("odd"), PROBLEM, "hit: odd: check disk and permissions\n"),
        (BrokenPipeError(), PROBLEM, ""),
        (KeyboardInterrupt(), INTERRUPTED, "hit: interrupted\n"),
        (click.Abort(), INTERRUPTED, "hit: interrupted\n"),
    ],
)
def test_expected_errors_become_one_line_and_an_exit_code(
    raised: BaseException, code: int, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    @one_line_errors("hit", Mine)
    def verb() -> None:
        raise raised

    with pytest.raises(SystemExit) as ended:
        verb()
    assert ended.value.code == code
    assert capsys.readouterr() == ("", line)


def test_unexpected_error_keeps_its_traceback() -> None:
    @one_line_errors("hit", Mine)
    def verb(number: int) -> float:
        """Divide."""
        return 1 / number

    assert verb(1) == 1
    assert verb.__doc__ == "Divide."
    with pytest.raises(ZeroDivisionError):
        verb(0)


@pytest.mark.parametrize("text", ["nan", "-NaN", "0", "-1", "much"])
def test_value_outside_the_range_is_refused(text: str) -> None:
    with pytest.raises(click.BadParameter):
        NumberRange(0, min_open=True).convert(text, None, None)


def test_value_in_the_range_is_accepted() -> None:
    assert NumberRange(0, min_open=True).convert("inf", None, None) == float("inf")
    assert NumberRange(0.1, 3.0).convert("3", None, None) == 3.0


def test_no_option_of_either_command_accepts_nan() -> None:
    """Only sizes to print are left out: they have no fixed range and are checked against the paper."""
    from acquire.cli import main as acquire
    from analyze.cli import main as analyze

    elsewhere = {"size_mm", "square_mm"}
    floats = [
        option
        for command in (acquire, analyze)
        for verb in command.commands.values()
        for option in verb.params
        if isinstance(option.type, click.types.FloatParamType) and option.name not in elsewhere
    ]
    assert {option.name for option in floats} == {
        "speed",
        "arm_length_mm",
        "countdown_s",
        "capture_fps_sd",
        "mat_ruler_mm",
        "friction",
        "energy",
        "bodies",
        "gravity",
        "marker_size_mm",
        "marker_size_sd_mm",
        "mass_g",
        "target_com_mm",
        "camera_sd_deg",
        "time_limit",
        "capture_fps",
        "bed_mm",
        "infill",
        "turn_sd_deg",
        "place_sd_mm",
        "wall_mm",
        "density_g_cm3",
        "fixture_mass_g",
    }
    assert all(isinstance(option.type, NumberRange) for option in floats)


@pytest.mark.parametrize(("name", "command"), [("acquire", acquire.cli.main), ("analyze", analyze.cli.main)])
def test_the_version_names_command_product_version_and_commit(name: str, command: click.Command) -> None:
    shown = CliRunner().invoke(command, ["--version"])
    assert shown.exit_code == 0
    version = rf"{name} \(Percuss\) \d+\.\d+\.\d+, commit (unknown|[0-9a-f]{{12,}}(-dirty)?)\n"
    assert re.fullmatch(version, shown.output)


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
@pytest.mark.parametrize(("name", "command"), [("acquire", acquire.cli.main), ("analyze", analyze.cli.main)])
def test_the_shell_completes_verbs_and_options(name: str, command: click.Command, shell: str) -> None:
    variable = f"_{name.upper()}_COMPLETE"
    verb, option = ("estimate", "--exclude") if name == "analyze" else ("demo", "--seed")
    for words, wanted in ((f"{name} {verb[:3]}", verb), (f"{name} {verb} {option[:5]}", option)):
        typed = words.split()[-1] if shell == "fish" else str(len(words.split()) - 1)
        environment = {variable: f"{shell}_complete", "COMP_WORDS": words, "COMP_CWORD": typed}
        shown = CliRunner().invoke(command, prog_name=name, env=environment)
        assert re.search(rf"(^|[,\n]){wanted}\b", shown.output), shown.output


@pytest.mark.parametrize("width", [60, 80, 200])
def test_help_is_not_cut(width: int) -> None:
    """Each command's first sentence stands whole in its group's help."""
    from acquire.cli import main as acquire
    from analyze.cli import main as analyze

    waiting: list[click.Command] = [acquire, analyze]
    while waiting:
        command = waiting.pop()
        context = click.Context(command, info_name=command.name, terminal_width=width)
        text = command.get_help(context).replace("]...", "]").replace("FILE...", "").replace("IMAGE...", "")
        for shown in ("SOURCE...", "PATH..."):
            text = text.replace(shown, "")
        assert "..." not in text, text
        assert "…" not in text, text
        if isinstance(command, click.Group):
            for one in command.commands.values():
                sentence = (one.help or "").split(". ")[0].split("\n\n")[0]
                assert "".join(sentence.split()).removesuffix(".") in "".join(text.split())
            waiting += command.commands.values()
