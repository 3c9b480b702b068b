"""A shell's syntax in the command of a program: refused, with the line that works."""

from __future__ import annotations

import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from simmer_tui.errors import ProgramError, TrialsError
from simmer_tui.grade.course import Team, submitted_team
from simmer_tui.program import Program
from simmer_tui.program.program_command import command_line_of, missing_program, words_of
from simmer_tui.program.shell_syntax import shell_command, shell_problem, shell_syntax
from simmer_tui.trials.cluster import pack

SHELL = [
    ("python a.py > out.txt", ">"),
    ("python a.py 2>&1", "2>&"),
    ("python a.py >>out.txt", ">>"),
    ("python a.py < in.txt", "<"),
    ("python a.py | tee out.txt", "|"),
    ("python a.py|tee out.txt", "|"),
    ("cd x && python a.py", "cd"),
    ("python a.py && echo done", "&&"),
    ("python a.py || true", "||"),
    ("python a.py; echo done", ";"),
    ("python a.py &", "&"),
    ("FOO=1 python a.py", "FOO="),
    ("export A=1", "export"),
    ("source venv/bin/activate", "source"),
    ("python $HOME/a.py", "$H"),
    ("python ${HOME}/a.py", "${"),
    ("python $(which a.py)", "$("),
    ("python `which a.py`", "`"),
    ("python ~/a.py", "~"),
    ("python 'my robot.py' > out.txt", ">"),
]
NO_SHELL = [
    "python a.py",
    "python -c 'import os; print(1 > 2 | 3) && x'",
    'python -c "a > b"',
    "python a.py http://host/?a=1&b=2;c",
    "python a.py --level=3 a~b x=1",
    r"python a.py \> \| \$HOME",
    "python 'it is > 5' \"$5\"",
    "python a.py *.csv",
    "bash -c 'cd x && python a.py'",
    "env FOO=1 python a.py",
    "",
    "   ",
    "python 'unclosed > x",
]


@pytest.mark.skipif(sys.platform == "win32", reason="the operators are those of POSIX")
@pytest.mark.parametrize(("command", "found"), SHELL)
def test_a_program_is_not_started_and_the_line_is_told(command: str, found: str) -> None:
    with pytest.raises(ProgramError, match="no shell is used; type --run"):
        Program(command, {}, lambda code: None)


@pytest.mark.parametrize(
    "words",
    ["-um timeit", "-Bc 'pass'", "-W ignore -m timeit", "--check-hash-based-pycs always -m timeit", "-"],
)
def test_a_program_without_a_file_misses_none(words: str) -> None:
    assert missing_program(f"python {words}") == ""
    assert "there is no file nosuch.py" in missing_program(
        "python -u --check-hash-based-pycs always nosuch.py"
    )


@pytest.mark.parametrize(("command", "found"), SHELL)
def test_a_shells_syntax_is_found(command: str, found: str) -> None:
    assert shell_syntax(command, windows=False) == found
    problem = shell_problem(command, windows=False)
    # The printed option, typed in a shell, gives a command that has the shell's work done.
    option = problem.partition("type --run ")[2]
    [typed] = shlex.split(option)
    assert shlex.split(typed) == ["bash", "-c", command]
    assert shell_syntax(typed, windows=False) == ""
    with pytest.raises(ProgramError, match="no shell is used"):
        words_of(command)


@pytest.mark.parametrize("command", NO_SHELL)
def test_what_a_program_gets_as_a_word_is_no_shells(command: str) -> None:
    assert shell_problem(command, windows=False) == ""


@pytest.mark.parametrize(
    ("command", "found"),
    [
        ("python a.py > out.txt", ">"),
        ("cd x && python a.py", "cd"),
        ("python a.py & echo done", "&"),
        ("python %USERPROFILE%\\a.py", "%USERPROFILE%"),
        ('"C:\\Program Files\\robot.exe" | more', "|"),
        ('python -c "a > b"', ""),
        ("python a.py 100% 50% it's", ""),
        ("python C:\\a.py http://host/?a=1&b=2", ""),
    ],
)
def test_a_shells_syntax_of_windows(command: str, found: str) -> None:
    assert shell_syntax(command, windows=True) == found
    if found:
        with pytest.raises(ProgramError, match="no shell is used; type --run"):
            command_line_of(command)
        assert shell_syntax(shell_command(command, windows=True), windows=True) == ""


def test_clusters_and_courses_refuse_it_too(tmp_path: Path) -> None:
    with pytest.raises(TrialsError, match="no shell is used"):
        pack("python a.py > out.txt", tmp_path)
    (tmp_path / "team.toml").write_text('command = "cd src && python \\"main.py\\""\n')
    team = submitted_team(Team("a", tmp_path, ""), tmp_path, "python main.py")
    [problem] = map(str, team.problems)
    line = problem.partition("write ")[2]
    (tmp_path / "team.toml").write_text(f"{line}\n")
    team = submitted_team(Team("a", tmp_path, ""), tmp_path, "python main.py")
    assert not team.problems
    assert team.command == shell_command('cd src && python "main.py"')


@pytest.mark.skipif(shutil.which("bash") is None, reason="the line has bash do it")
def test_the_line_that_is_told_works(tmp_path: Path) -> None:
    run = [sys.executable, "-m", "simmer_tui", "--no-ui", "--quiet", "--port", "0", "--run"]
    command = f"{shlex.quote(sys.executable)} -c 'print(7)' > out.txt"
    refused = subprocess.run([*run, command], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert refused.returncode != 0
    assert not (tmp_path / "out.txt").exists()
    [line] = refused.stderr.splitlines()
    [typed] = shlex.split(line.partition("type --run ")[2])
    subprocess.run([*run, typed], cwd=tmp_path, capture_output=True, check=False)
    assert (tmp_path / "out.txt").read_text() == "7\n"
