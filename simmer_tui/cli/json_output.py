"""Answers of commands: as text on the terminal, or with the option `--json` as JSON, for scripts."""

from __future__ import annotations

import argparse
import sys

from simmer_tui.document.as_json import json_text
from simmer_tui.document.model import Document
from simmer_tui.errors import ConfigurationError


def add_json_option(parser: argparse.ArgumentParser) -> None:
    """The option `--json`."""
    parser.add_argument("--json", action="store_true", help="print the answer as JSON, for scripts")


def print_answer(document: Document, *, as_json: bool = False) -> None:
    """Print a document on standard output."""
    if as_json:
        print_json(document)
        return
    from rich.console import Console

    from simmer_tui.document.as_terminal import print_document

    print_document(document, Console())


def print_json(value: object) -> None:
    """Print a value as one JSON text on standard output."""
    sys.stdout.write(json_text(value))


def problems_of(error: ConfigurationError) -> list[dict[str, str]]:
    """The mistakes of a set, each with its place."""
    return [{"where": problem.where, "text": problem.what} for problem in error.problems]
