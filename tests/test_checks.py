"""The checks that read the code: style, types, and the contract of what imports what."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
BIN = Path(sys.executable).parent
CHECKS = {
    "ruff check": ["ruff", "check", "."],
    "ruff format": ["ruff", "format", "--check", "."],
    "mypy": ["mypy"],
    "import contracts": ["lint-imports", "--no-cache"],
}


@pytest.mark.parametrize("name", CHECKS)
def test_the_code_passes(name: str) -> None:
    program, *arguments = CHECKS[name]
    found = shutil.which(program, path=str(BIN)) or shutil.which(program)
    assert found, f"{program} is not installed; pip install '.[test]' brings it"
    done = subprocess.run([found, *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_ci_runs_the_command_that_the_readme_names() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    commands = re.findall(r"^pip install .*pytest.*$", readme, re.MULTILINE)
    assert commands == ["pip install '.[test]' && python -m pytest"]
    assert "README.md" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")


def test_the_readme_names_only_options_and_commands_there_are() -> None:
    from simmer_tui.cli.main import build_parser

    known = set(re.findall(r"--[a-z0-9-]+", build_parser().format_help()))
    commands = set(re.findall(r"simmer-tui ([a-z]+)", build_parser().format_help()))
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    for line in re.findall(r"simmer-tui[^`\n|]*", readme):
        words = line.split()
        if len(words) > 1 and re.fullmatch(r"[a-z]+", words[1]):
            assert words[1] in commands, line
        elif len(words) > 1 and words[1].startswith("--"):
            for option in re.findall(r"--[a-z0-9-]+", line.partition('"')[0]):
                assert option in known, line
