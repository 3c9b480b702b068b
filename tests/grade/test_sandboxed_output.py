"""Output of a sandboxed program: two streams, each with its last lines, and its error where it crashed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from simmer_tui.cli.log_reports import build_report
from simmer_tui.grade.course import read_course
from simmer_tui.grade.grade_folder import GradeFolder
from simmer_tui.grade.grade_run import GradeRun
from simmer_tui.grade.sandbox import Isolation
from tests.grade.conftest import CONNECT

CRASH = (
    CONNECT
    + """
s.sendall(b"u1\\n")
r.recv(99)
print("on its way", flush=True)
print("a warning", file=sys.stderr, flush=True)
{}["u9"]
"""
)


def test_streams_of_a_sandboxed_program_are_two(
    isolation: str, make_course: Callable[..., Path], tmp_path: Path
) -> None:
    file = make_course({"crash": CRASH})
    folder = GradeFolder.create(tmp_path / "out", read_course(file), 7, Isolation(isolation))
    [entry] = folder.entries
    result = GradeRun(folder.trial(entry, 1), folder.runs).run()
    assert ": KeyError: 'u9' in main.py:10." in result.verdict["text"]
    program = build_report(folder.log(entry, 1)).verdict.program
    assert program is not None
    assert [line.text for line in program.stdout] == ["on its way"]
    first, *_, last = (line.text for line in program.stderr)
    assert (first, last) == ("a warning", "KeyError: 'u9'")
    printed = (folder.runs / "crash" / "0001.txt").read_text().splitlines()
    assert printed[:2] == ["on its way", "a warning"]


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("kind", ["bwrap", "none"])
def test_a_command_that_is_not_there_is_a_failure_of_its_team(
    kind: str, request: pytest.FixtureRequest, make_course: Callable[..., Path], tmp_path: Path
) -> None:
    isolation = Isolation(request.getfixturevalue("isolation") if kind == "bwrap" else kind)
    file = make_course({"lost": CRASH})
    (tmp_path / "teams" / "lost" / "team.toml").write_text('command = "no-such-command main.py"\n')
    folder = GradeFolder.create(tmp_path / "out", read_course(file), 7, isolation)
    [entry] = folder.entries
    result = GradeRun(folder.trial(entry, 1), folder.runs).run()
    assert (result.success, result.exit_code) == (False, 127)
    assert result.verdict["text"].startswith("The program could not start: ")
    assert "no-such-command" in result.verdict["text"]
    assert build_report(folder.log(entry, 1)).verdict.text == result.verdict["text"]
