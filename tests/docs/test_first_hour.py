"""First hour of a newcomer: the shell blocks of README, tutorial and how-to guides run as printed.

Each page runs in a copy of the project of its own, with the environment of `make setup`. Before a page that
names a user's files the copy gets them: rendered videos for the phone (tests/docs/phone_videos.py), the
recording made of them, the committed sample, and others (tests/docs/newcomer_files.py). In place of a rig it
gets the virtual one (`acquire virtual`). Not run is only what `NOT_RUN` names, with its reason. What runs
until Ctrl-C runs in the background; questions are answered with yes, in a terminal. A window cannot open
here: what `analyze replay` would show is written to a file.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests import make_phone_videos as renderer
from tests.docs import newcomer_files
from tests.docs.pages import DOCS, snippets
from tests.docs.phone_videos import TEABOX, write_boards, write_strikes
from tests.loopback import loopback
from tests.places import ROOT

pytestmark = [pytest.mark.slow, pytest.mark.timeout(3600)]

FRONT = ("README.md", "docs/index.md", "docs/tutorial/virtual-rig.md")
"""pages that are read one after the other, in one shell"""
PHONE, ANYWHERE = "docs/tutorial/phone.md", "docs/how-to/register-tags.md"
HOW_TO_RIG = ("docs/how-to/rig.md", "docs/how-to/session.md", "docs/how-to/plan.md")
"""guides for a rig's first session, in the order of their commands"""
HOW_TO = sorted(
    {page.relative_to(ROOT).as_posix() for page in (DOCS / "how-to").glob("*.md")} - {ANYWHERE, *HOW_TO_RIG}
)
NOT_RUN = {
    ("docs/how-to/cluster.md", ".*"): "needs other computers",
    ("docs/how-to/console.md", "ssh .*"): "needs another computer",
    ("docs/how-to/hardware.md", "PERCUSS_RIG=.*"): "needs a real camera and servo: the tests of both",
    ("docs/how-to/hardware.md", "sudo .*"): "changes the system: tests/docs/test_service_files.py",
    ("docs/how-to/hardware.md", "(acquire (run|session)|analyze estimate) .*"): "needs a rig, and the block",
    (
        "docs/how-to/session.md",
        "acquire strike --calibrate .*",
    ): "needs bodies hung on a thread before the arm",
    (
        "docs/how-to/session.md",
        "acquire session .* --resume teabox.mcap",
    ): "needs a session that ended early: tests/system/test_adaptive_session.py",
    ("docs/how-to/archive.md", "analyze batch 's3://.*"): "needs a bucket: tests/analyze/batch",
    ("docs/how-to/install.md", "podman .*"): "needs a builder: tests/docs/test_containers.py",
    (
        "docs/how-to/install.md",
        r"sudo apt .*|.*-m venv \.venv .*|\.venv/bin/.*",
    ): "needs a computer with another system",
}
"""why lines of a page (regular expression, whole line without its comment) are not run"""
ON_A_RIG = "acquire .*|analyze .*(--rig|first.mcap) .*"
"""lines of `ANYWHERE` for a rig; the others are for a phone"""
GIVEN = {
    "docs/how-to/across-sessions.md": newcomer_files.write_months_of_results,
    "docs/how-to/calibrate-camera.md": newcomer_files.write_board_images,
    "docs/how-to/fixtures.md": newcomer_files.write_objects_for_fixtures,
    "docs/how-to/frame-rate.md": newcomer_files.write_drop,
    "docs/how-to/hardware.md": newcomer_files.write_block_and_rig,
    "docs/how-to/gravity.md": newcomer_files.write_plumb_line,
    "docs/how-to/import-topics.md": newcomer_files.write_topics,
    "docs/how-to/import-videos.md": newcomer_files.write_one_video,
    "docs/how-to/object-file.md": newcomer_files.write_corrected_object,
    "docs/how-to/parts.md": newcomer_files.write_labelled_object,
    "docs/how-to/rig-parts.md": newcomer_files.write_block_and_rig,
}
"""files that a page takes for granted, besides those of the phone tutorial"""
VIRTUAL_RIG = [
    "acquire virtual --object teabox.toml",
    "cp virtual-rig/rig.toml rig.toml",
    "mkdir -m 700 $XDG_RUNTIME_DIR/percuss",
    """ln -s "$(sed -n 's/^socket = "\\(.*\\)"/\\1/p' rig.toml)" $XDG_RUNTIME_DIR/percuss/daemon.sock""",
]
"""lines that give a page a rig: the documented one without hardware, reached like a rig of one's own"""
RIG = next(body for body in snippets(DOCS / "how-to" / "rig.md", "toml") if "[camera]" in body)
ANSWER_YES = """\
import os, pty, sys
answers = [b'y\\n']
status = pty.spawn(sys.argv[1:], stdin_read=lambda _: answers.pop() if answers else b'')
sys.exit(os.waitstatus_to_exitcode(status))
"""
"""program that runs its arguments in a terminal, whose user answers yes"""
SHELL = f"""\
set -euo pipefail
trap 'kill $(jobs -p) 2> /dev/null || true; wait' EXIT
analyze() {{
  if [ "${{1-}}" = import ]; then in_a_terminal analyze "$@"; return; fi
  if [ "${{1-}}" = replay ] && ! [[ "$*" =~ --(save|screenshot|animation) ]]; then
    set -- "$@" --save "$(mktemp -u).rrd"
  fi
  command analyze "$@"
}}
in_a_terminal() {{  # the question before videos are imported is for a person alone
  {sys.executable} -c "{ANSWER_YES}" "$(type -P "$1")" "${{@:2}}"
}}
acquire() {{
  local code=0
  case "${{1-}}" in
    virtual | demo) set -- "$@" --address {loopback(141)} ;;
    console) set -- "$@" --no-browser --port 0 ;;
  esac
  case "${{1-}}" in
    virtual | run | console)
      command acquire "$@" > "$1.log" 2>&1 &
      until grep -Eq '^(ready: |  analyze report |console, for one browser)' "$1.log"; do
        kill -0 $! || {{ cat "$1.log" >&2; exit 1; }}
        sleep 0.2
      done ;;
    check)  # speeds that a busy computer does not reach are no fault of the page
      command acquire "$@" > check.log || code=$?
      cat check.log
      ! grep '^FAIL' check.log | grep -Ev '^FAIL +(frames|disk speed|camera clock) ' || return $code
      grep -q '^pass  object at rest' check.log ;;
    *)  # 3: frames were lost on a busy computer, or the arm met nothing
      command acquire "$@" < <(yes) || code=$?
      [[ $code = 0 || $code = 3 && "$1" =~ ^(demo|session|strike)$ ]] ;;
  esac
}}
"""


def lines_of(page: str) -> list[str]:
    """Lines of a page's shell blocks that are run."""
    lines = "".join(snippets(ROOT / page, "sh")).replace("\\\n", " ").splitlines()
    return [line for line in lines if reason_not_to_run(page, line) is None]


def command_of(line: str) -> str:
    """A line without its comment."""
    return re.sub(r"\s+#.*", "", line).strip()


def reason_not_to_run(page: str, line: str) -> str | None:
    command = command_of(line)
    return next(
        (why for (where, what), why in NOT_RUN.items() if where == page and re.fullmatch(what, command)), None
    )


def each_demo_once(lines: list[str]) -> list[str]:
    """Lines without the repetitions of a `make demo` command that an earlier line runs."""
    demos: set[str] = set()
    kept = []
    for line in lines:
        command = command_of(line)
        if command not in demos:
            kept.append(line)
        if command.startswith("make demo"):
            demos.add(command)
    return kept


def copy_project(folder: Path) -> Path:
    """Copy the tracked files with their times, so that `make` finds the environment up to date."""
    for name in filter(None, _git("ls-files", "-z").split("\0")):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, folder / name)
    (folder / ".git").write_text(
        f"gitdir: {_git('rev-parse', '--absolute-git-dir').strip()}\n", encoding="ascii"
    )
    (folder / ".venv").symlink_to(ROOT / ".venv")
    return folder


def _git(*arguments: str) -> str:
    return subprocess.run(
        ["git", "-C", str(ROOT), *arguments], capture_output=True, text=True, check=True
    ).stdout


def run(lines: list[str], folder: Path, *, activated: bool = True) -> str:
    """Run lines in one shell, and return its output.

    Args:
        lines: lines of shell blocks.
        folder: where to run them: a copy of the project.
        activated: True if the reader has put the commands on the PATH before.
    """
    up_to_date = subprocess.run(["make", "-q", "setup"], cwd=folder, capture_output=True, check=False)
    assert up_to_date.returncode == 0, "run `make setup` first: these tests would change the environment"
    kept = ("LANG", "LC_ALL", "TMPDIR", "SSL_CERT_FILE", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")
    environment = {
        name: value for name, value in os.environ.items() if name in kept or name.startswith(("PIP_", "UV_"))
    }
    here = f"{ROOT / '.venv' / 'bin'}:" if activated else ""
    home = folder.parent / f"{folder.name}-home"
    home.mkdir(exist_ok=True)
    environment |= {
        "HOME": str(home),
        "XDG_RUNTIME_DIR": str(home),
        "PATH": f"{here}/usr/local/bin:/usr/bin:/bin:/usr/sbin:/sbin",
        "UV_TOOL_DIR": str(home / "tools"),
        "UV_TOOL_BIN_DIR": str(home / "bin"),
        "UV_CACHE_DIR": os.environ.get("UV_CACHE_DIR", str(Path.home() / ".cache" / "uv")),
    }
    done = subprocess.run(
        ["bash", "-xc", SHELL + "\n".join(lines)],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"exit code {done.returncode}\n{done.stdout[-2000:]}\n{done.stderr[-3000:]}"
    return done.stdout


@pytest.fixture
def project() -> Iterator[Path]:
    """Copy of the project, removed afterwards: a demo's recording and an environment are gigabytes."""
    with tempfile.TemporaryDirectory(prefix="percuss-hour-") as folder:
        yield copy_project(Path(folder, "project"))


@pytest.fixture(scope="module")
def phone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Copy of the project in which all commands of the phone tutorial were run."""
    folder = copy_project(tmp_path_factory.mktemp("hour") / "phone")
    run_filmed(lines_of(PHONE), folder)
    return folder


def run_filmed(lines: list[str], folder: Path) -> None:
    """Run lines of the phone tutorial; videos of the planned strikes are written before their import."""
    write_boards(folder)
    filmed = next(number for number, line in enumerate(lines) if line.startswith("analyze import s*.mp4"))
    run(lines[:filmed], folder)
    write_strikes(folder)
    run(lines[filmed:], folder)


def give_phone_files(folder: Path, phone: Path) -> None:
    """Copy into `folder` the files that the phone tutorial leaves in the project `phone`."""
    names = ("teabox.toml", "plan.json", "camera.toml", "board.mp4", "teabox.mcap")
    for path in [phone / name for name in names] + sorted(phone.glob("s?.mp4")):
        shutil.copy(path, folder)


def give_sessions(folder: Path) -> None:
    """Write three recordings of one object, among which the strikes of the tutorial are divided."""
    strikes = sorted(folder.glob("s?.mp4"))
    for name, filmed in zip("abc", (strikes[:3], strikes[3:6], strikes[6:]), strict=True):
        command = (
            f"analyze import {' '.join(path.name for path in filmed)} --object teabox.toml --plan plan.json"
        )
        run([f"{command} --camera camera.toml -o {name}.mcap"], folder)


def remove_outputs(lines: list[str], folder: Path) -> None:
    """Remove from `folder` the files that the lines write (`-o FILE`) before they name them otherwise."""
    text = "\n".join(lines)
    for written in re.finditer(r" -o (\S+)", text):
        if written[1] not in text[: written.start()]:
            (folder / written[1]).unlink(missing_ok=True)


def test_the_front_pages_run_as_printed_and_end_with_an_answer(project: Path, phone: Path) -> None:
    lines = each_demo_once([line for page in FRONT for line in lines_of(page)])
    for path in [phone / "board.mp4", *sorted(phone.glob("s?.mp4"))]:
        shutil.copy(path, project)
    output = run(lines, project, activated=False)
    assert "centre of mass" in output
    assert "next: source .venv/bin/activate" in output
    for name in (
        "recordings/demo-carton-1.html",
        "recordings/demo-spray-3.rrd",
        "teabox.html",
        "plan-cards.html",
    ):
        assert (project / name).stat().st_size > 10_000


def test_the_phone_tutorial_runs_as_printed_and_its_answer_holds_the_truth(phone: Path) -> None:
    assert_answer(run(["analyze estimate teabox.mcap --json"], phone))


def assert_answer(printed: str) -> None:
    """Check the centre of mass of a result (JSON) against that of the rendered box."""
    answer = json.loads(printed)["centre_of_mass"]
    assert np.abs(np.array(answer["value"]) - renderer.COM).max() < 3e-4


def test_tags_glued_on_anywhere_are_found_with_a_phone(project: Path) -> None:
    text = TEABOX.read_text(encoding="utf-8")
    (project / "teabox.toml").write_text(re.sub("(?m)^T_object_marker.*\n", "", text), encoding="utf-8")
    run_filmed([line for line in lines_of(ANYWHERE) if not is_on_a_rig(line)], project)
    assert_answer(run(["analyze estimate teabox.mcap --object teabox-tags.toml --json"], project))
    true = {each["id"]: each["T_object_marker"] for each in tomllib.loads(text)["marker"]}
    found = tomllib.loads((project / "teabox-tags.toml").read_text(encoding="utf-8"))["marker"]
    off = [
        np.array(each["T_object_marker"])[:3, 3] - np.array(true[each["id"]])[:3, 3]
        for each in found
        if "T_object_marker" in each
    ]
    assert len(off) >= 3
    assert np.abs(off).max() < 2e-3


def is_on_a_rig(line: str) -> bool:
    return re.fullmatch(ON_A_RIG, command_of(line)) is not None


def test_tags_glued_on_anywhere_are_found_on_a_rig(project: Path) -> None:
    text = re.sub("(?m)^T_object_marker.*\n", "", TEABOX.read_text(encoding="utf-8"))
    (project / "teabox.toml").write_text(text, encoding="utf-8")
    run([*VIRTUAL_RIG, "acquire run rig.toml", *filter(is_on_a_rig, lines_of(ANYWHERE))], project)
    found = tomllib.loads((project / "teabox-tags.toml").read_text(encoding="utf-8"))["marker"]
    assert sum("T_object_marker" in each for each in found) >= 2


def test_the_guides_for_a_rig_run_as_printed(project: Path) -> None:
    checked, struck, planned = map(lines_of, HOW_TO_RIG)
    shutil.copy(TEABOX, project)
    plan = "analyze plan teabox.toml --rig rig.toml --strikes 3 -o plan.json"
    run([*VIRTUAL_RIG, *checked, plan, *struck, "rm plan.json", *planned], project)
    assert (project / "more.mcap").exists()


@pytest.mark.parametrize("page", HOW_TO)
def test_a_how_to_guide_runs_as_printed(page: str, project: Path, phone: Path) -> None:
    lines = lines_of(page)
    if not any(line.strip() and not line.startswith("#") for line in lines):
        pytest.skip("nothing to run on this page")
    give_phone_files(project, phone)
    (project / "rig.toml").write_text(RIG, encoding="utf-8")
    if page == "docs/how-to/several-sessions.md":
        give_sessions(project)
    if page in GIVEN:
        GIVEN[page](project)
    remove_outputs(lines, project)
    run(lines, project)


def test_the_documented_line_completes_both_commands(project: Path) -> None:
    (line,) = [line for line in lines_of("docs/how-to/install.md") if line.startswith("echo")]
    shown = run([line, "source ~/.bashrc", "complete -p analyze acquire"], project)
    assert shown.count("complete -o nosort -F") == 2


def test_every_exception_is_of_a_line_that_a_page_has() -> None:
    unused = []
    for page, what in NOT_RUN:
        commands = map(command_of, "".join(snippets(ROOT / page, "sh")).splitlines())
        if not any(re.fullmatch(what, command) for command in commands):
            unused.append((page, what))
    assert not unused
