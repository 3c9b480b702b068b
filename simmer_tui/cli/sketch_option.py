"""The option `--sketch`: the set whose boards drive the robot, and its compiled sketches."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

from simmer_tui.cli.command_line import say
from simmer_tui.config.loader import Configuration
from simmer_tui.config.set_sketches import WIRING_FILE
from simmer_tui.config.sets import has_set, set_in
from simmer_tui.config.settings_file import Override
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim.command import typed_path
from simmer_tui.sketch.build import long_build_notice
from simmer_tui.sketch.sketch_robot import SketchSet, compile_set, with_boards
from simmer_tui.sketch.wiring import wiring_of

_DRAFTED = "my-robot"
"""Folder of a set that is proposed for a sketch without one."""


def sketch_set(
    options: argparse.Namespace, overrides: Mapping[str, Override], command: str = "simmer-tui"
) -> str:
    """The set of `--sketch`; `command` is that of messages. Raises ConfigurationError."""
    if options.config is not None:
        raise ConfigurationError([Problem("--sketch", "names the set already: leave --config out")])
    if "serial.port" in overrides:
        what = "runs boards in the simulator: leave --serial out"
        raise ConfigurationError([Problem("--sketch", what)])
    path = Path(options.sketch)
    is_sketch = path.is_dir() and not has_set(set_in(path)) and any(path.glob("*.ino"))
    if is_sketch or path.is_file():
        # The set is beside the sketch, one folder up, in `config` there, or where the advice below puts it.
        beside = path if is_sketch else path.parent
        folder = beside.resolve()
        places = [*(set_in(each) for each in (beside, folder.parent, Path(_DRAFTED))), folder / _DRAFTED]
        there = next((each for each in places if (each / WIRING_FILE).is_file()), None)
        is_what = "has a sketch and no set" if is_sketch else "is a file"
        what = f"{is_what}; --sketch takes the folder of the set that names it"
        if there is None:
            what = f"{what}. Make one: simmer-tui init {_DRAFTED} --sketch {typed_path(path)}"
        else:
            what = f"{what}: {command} --sketch {typed_path(there)}"
        raise ConfigurationError([Problem(str(path), what)])
    return str(options.sketch)


def tell_long_build() -> None:
    """Tell a build that takes minutes before it begins."""
    notice = long_build_notice()
    if notice:
        say(notice)


def compiled(configuration: Configuration) -> tuple[Configuration, SketchSet]:
    """A set's configuration with its boards, and their compiled sketches. Raises ConfigurationError."""
    wiring = wiring_of(configuration)
    if wiring is None:
        what = f"the set {configuration.name} has no {WIRING_FILE}, which says what runs on its boards"
        raise ConfigurationError([Problem("--sketch", what)])
    tell_long_build()
    return with_boards(configuration), compile_set(wiring, configuration.directory)
