"""The start of the screen."""

from __future__ import annotations

import pytest

from simmer_tui.cli.app_start import program_name


@pytest.mark.parametrize(
    ("command", "name"),
    [
        ("python scripts/wander.py --steps 200", "wander.py"),
        ("python3.11 team/solve.py", "solve.py"),
        ("python -u solve.py", "solve.py"),
        ("python 'my robot.py'", "my robot.py"),
        ("octave-cli solve.m", "solve.m"),
        ("./solve --gain 0.5 table.csv", "solve"),
        ("python -m team.solve", "python"),
        ("it's", "it's"),
        ("", ""),
    ],
)
def test_a_program_is_named_by_its_file_not_by_its_interpreter(command: str, name: str) -> None:
    assert program_name(command) == name
