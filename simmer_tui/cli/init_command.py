"""`simmer-tui init`: a configuration set to be edited, or a whole course."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from pathlib import Path

from simmer_tui.cli.command_line import ExitCode, OneLineParser, add_flag, print_lines, subcommand
from simmer_tui.cli.set_output import add_mission_option, write_set_files
from simmer_tui.config.new_set import (
    enabled_codes,
    schema_path,
    term_files,
    with_comments,
    with_dialect,
    with_mission,
)
from simmer_tui.config.sensors_csv import FILE as SENSORS_FILE
from simmer_tui.config.set_sketches import SKETCH_ENDINGS, WIRING_FILE, is_sketch_path
from simmer_tui.config.sets import (
    LOCAL_FOLDER,
    MISSION_SET,
    bundled_folder,
    bundled_sets,
    decoded,
    find_set,
    has_set,
    read_files,
    set_in,
    set_name,
)
from simmer_tui.config.settings import NO_WHEELS
from simmer_tui.config.settings_file import FILE as SETTINGS_FILE
from simmer_tui.dialect.frames import FrameKind
from simmer_tui.errors import ConfigurationError, Problem, reason_of
from simmer_tui.sim.command import typed_path


def _init_options(parser: OneLineParser) -> None:
    parser.add_argument(
        "directory",
        metavar="DIR",
        type=Path,
        nargs="?",
        help="the folder to write; made if it does not exist (with --sketch, by default: config)",
    )
    sets = ", ".join(bundled_sets())
    parser.add_argument("--from", dest="source", metavar="SET", help=f"copy this set: {sets}, or a folder")
    add_mission_option(parser)
    text = "write a whole course: set, mission, samples, a page for students, devcontainer, CI, grading"
    add_flag(parser, "--term", text)
    parser.add_argument(
        "--dialect",
        choices=[each.value for each in FrameKind],
        help="add a dialect.toml to be edited, for messages that are lines, in brackets, bytes or binary",
    )

    parser.add_argument(
        "--sketch",
        metavar="FILE.ino",
        type=Path,
        nargs="+",
        help="draft a wiring.toml from these sketches, one for each board, beside the set in DIR",
    )


@subcommand("init", _init_options)
def run_init(options: argparse.Namespace) -> int:
    """Copy a configuration set into a folder, to be edited there."""
    if options.sketch is not None:
        _take_directory(options)
    if options.directory is None:
        run_init.parser().error("the following arguments are required: DIR")
    if options.sketch is not None:
        # In the folder of a course the set is one below.
        options.directory = set_in(options.directory)
        if has_set(options.directory):
            return _draft_beside(options)
    source = bundled_folder() if options.source is None else find_set(options.source)
    mission = options.mission or options.term
    if mission and source == bundled_folder():
        source = bundled_sets()[MISSION_SET]  # the same robot, with a gripper and realistic delays
    files, name = read_files(source), set_name(source)
    if options.dialect is not None:
        files = with_dialect(files, FrameKind(options.dialect))
    # With a sketch the set becomes that of a team's own robot, no variant of another one.
    nominal = name if name in bundled_sets() and options.sketch is None else ""
    files = with_comments(with_mission(files) if mission else files, nominal)
    if options.sketch is not None:
        home = options.directory / LOCAL_FOLDER if options.term else options.directory
        drafted = _drafted(options.sketch, home, decoded(SENSORS_FILE, files.get(SENSORS_FILE, b"")))
        files = with_comments({**files, **drafted})
        layout = _layout_of(drafted[WIRING_FILE])
        if layout and SETTINGS_FILE in files:
            # Motors and encoders are those of wheels, which most sets do not describe.
            none, found = f'layout = "{NO_WHEELS}"'.encode(), f'layout = "{layout}"  # ?'.encode()
            files[SETTINGS_FILE] = files[SETTINGS_FILE].replace(none, found, 1)
    if options.term:
        files = term_files(files)
    wrote = write_set_files(options.directory, files)
    check = f"simmer-tui check {typed_path(options.directory)}"
    marked = f'Look at every line of {WIRING_FILE} with "# ?"' if options.sketch else ""
    if options.term:
        print_lines(
            f"Wrote {len(files)} files of a course to {options.directory}; "
            "README.md is the page for students",
            *([f"{marked} in {LOCAL_FOLDER}."] if marked else ()),
            f"Edit {LOCAL_FOLDER} and course.toml in it, then: {check}",
        )
    else:
        print_lines(wrote, f"{marked or 'Edit them'}, then: {check}")
    return ExitCode.DONE


def _take_directory(options: argparse.Namespace) -> None:
    """Take DIR out of the sketches before which it was not given: `init --sketch rover.ino my-robot`."""
    last = options.sketch[-1]
    is_named_so = last.suffix.lower() in SKETCH_ENDINGS
    # The folder of a sketch that is named too is where the set is to be: `init --sketch rover.ino .`
    has_others = any(each.resolve().parent == last.resolve() for each in options.sketch[:-1])
    is_sketch = is_named_so or (is_sketch_path(last) and not has_others)
    if options.directory is None and len(options.sketch) > 1 and not is_sketch:
        options.directory = options.sketch.pop()
    if options.directory is None:
        options.directory = Path(LOCAL_FOLDER)


def _draft_beside(options: argparse.Namespace) -> int:
    """Write a wiring.toml beside the files of a set, whose other files stay."""
    if options.source or options.mission or options.term or options.dialect:
        what = "has a set already; only --sketch adds a file to one"
        raise ConfigurationError([Problem(str(options.directory), what)])
    sensors = (
        (options.directory / SENSORS_FILE).read_bytes()
        if (options.directory / SENSORS_FILE).is_file()
        else b""
    )
    made = with_comments(_drafted(options.sketch, options.directory, decoded(SENSORS_FILE, sensors)))
    if (options.directory / schema_path(WIRING_FILE)).exists():
        del made[schema_path(WIRING_FILE)]  # the same in every set
    print_lines(write_set_files(options.directory, made))
    print_lines(f'Look at every line with "# ?", then: simmer-tui check {typed_path(options.directory)}')
    return ExitCode.DONE


def _layout_of(wiring: bytes) -> str:
    """The layout of the wheels in a drafted wiring.toml; empty if it has none."""
    from simmer_tui.sketch.wheel_draft import layout_with

    return layout_with(re.findall(r'^wheel = "(.+?)"', wiring.decode(), re.MULTILINE)) or ""


def _drafted(sketches: Sequence[Path], directory: Path, sensors: str) -> dict[str, bytes]:
    """A wiring.toml for sketches, with the codes of a set's sensors. Raises ConfigurationError."""
    from simmer_tui.sketch.wiring_draft import draft

    codes = enabled_codes(sensors)
    ranges = [code for name, code in codes.items() if name.startswith("ultra")]
    others = [code for name, code in codes.items() if name.startswith("ir")]
    beams = [code for name, code in codes.items() if name.startswith("tof")]
    gyros = [code for name, code in codes.items() if name.startswith("gyro")]
    problems = [
        Problem(str(sketch), "there is no such sketch; name an .ino file, or its folder")
        for sketch in sketches
        if not is_sketch_path(sketch)
    ]
    if problems:
        raise ConfigurationError(problems)
    try:
        return {WIRING_FILE: draft(sketches, directory, ranges, others, beams, gyros).encode()}
    except (OSError, ValueError) as error:
        raise ConfigurationError([Problem("--sketch", f"cannot be read: {reason_of(error)}")]) from None
