"""A problem is one line and an exit code, whichever command it is."""

from __future__ import annotations

import pytest

from schemas.command_line import INTERRUPTED, PROBLEM, one_line_errors
from schemas.documents import DocumentError


class Mine(Exception):
    pass


@pytest.mark.parametrize(
    ("raised", "code", "line"),
    [
        (Mine("a thing: its remedy"), PROBLEM, "hit: a thing: its remedy\n"),
        (DocumentError("x.toml: unknown key"), PROBLEM, "hit: x.toml: unknown key\n"),
        (FileNotFoundError(2, "No such file", "x"), PROBLEM, "hit: x: No such file: check disk and permissions\n"),
        (OSError("odd"), PROBLEM, "hit: odd: check disk and permissions\n"),
        (BrokenPipeError(), PROBLEM, ""),
        (KeyboardInterrupt(), INTERRUPTED, "hit: interrupted\n"),
    ],
)
def test_what_a_verb_raises(raised: BaseException, code: int, line: str, capsys: pytest.CaptureFixture[str]) -> None:
    @one_line_errors("hit", Mine)
    def verb() -> None:
        raise raised

    with pytest.raises(SystemExit) as ended:
        verb()
    assert ended.value.code == code
    assert capsys.readouterr() == ("", line)


def test_a_mistake_of_ours_keeps_its_traceback_and_a_result_passes() -> None:
    @one_line_errors("hit", Mine)
    def verb(number: int) -> float:
        """Divide."""
        return 1 / number

    assert verb(1) == 1
    assert verb.__doc__ == "Divide."
    with pytest.raises(ZeroDivisionError):
        verb(0)
