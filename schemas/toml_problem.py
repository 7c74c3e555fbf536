"""The line of a TOML file that cannot be read, for error messages."""

from __future__ import annotations

import re

MAX_QUOTED = 60
"""Characters of a line that an error message quotes."""


def quoted_line(text: str, problem: str) -> str:
    """Clause that quotes the line named in tomllib's message, ": correct this line: size_m = [1 2]".

    Args:
        text: content of the TOML file.
        problem: tomllib's message.

    Returns:
        The clause, at most `MAX_QUOTED` characters of the line; "" if the message names no line.
    """
    number = re.search(r"\(at line (\d+),", problem)
    lines = text.splitlines()
    if number is None or int(number[1]) > len(lines):
        return ""
    line = "".join(letter if letter.isprintable() else " " for letter in lines[int(number[1]) - 1]).strip()
    return f": correct this line: {line[:MAX_QUOTED]}{'...' if len(line) > MAX_QUOTED else ''}"
