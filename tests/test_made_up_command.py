"""A command is a function with its options and a row: this file adds one, and nothing else knows of it."""

from __future__ import annotations

import argparse
import sys
from types import ModuleType

import pytest

from simmer_tui.cli import main as command_line
from simmer_tui.cli.command_line import OneLineParser, subcommand
from simmer_tui.cli.completion_command import whole_parser
from simmer_tui.errors import SimmerError


class GreetingError(SimmerError):
    """There is nobody to greet."""


def add_options(parser: OneLineParser) -> None:
    parser.add_argument("name")


@subcommand("hello", add_options)
def run_hello(options: argparse.Namespace) -> int:
    """Greet somebody."""
    if options.name == "nobody":
        raise GreetingError("there is nobody to greet: name somebody")
    sys.stdout.write(f"hello {options.name}\n")
    return 0


def test_help_completion_and_exit_codes_come_of_the_row(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    module = ModuleType("simmer_tui.cli.hello_command")
    vars(module)["run_hello"] = run_hello
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setitem(command_line.SUBCOMMANDS, "hello", ("hello_command:run_hello", "greet somebody"))
    assert command_line.main(["hello", "Ada"]) == 0
    assert capsys.readouterr().out == "hello Ada\n"
    assert command_line.main(["hello", "nobody"]) == 2
    assert capsys.readouterr().err == "simmer-tui hello: there is nobody to greet: name somebody\n"
    assert "greet somebody" in command_line.build_parser().format_help()
    assert "hello" in whole_parser().format_help()
