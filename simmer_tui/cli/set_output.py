"""The files of a set that commands write, with the option for a mission."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

from simmer_tui.cli.command_line import add_flag
from simmer_tui.config.new_set import SCHEMA_FOLDER as SCHEMAS
from simmer_tui.config.sets import write_files


def add_mission_option(parser: argparse.ArgumentParser) -> None:
    """The option `--mission` of the commands that write a set."""
    add_flag(parser, "--mission", "add a gripper, a load sensor and a mission.toml")


def write_set_files(directory: Path, files: Mapping[str, bytes]) -> str:
    """Write the files of a set; returns a line with their names, without the schemas. Raises
    ConfigurationError."""
    written = [path.relative_to(directory) for path in write_files(directory, files)]
    names = ", ".join(path.as_posix() for path in written if path.parts[0] != SCHEMAS)
    return f"Wrote {names} to {directory}"
