"""The commands for configuration sets: `init`, `check` and `import`."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from simmer_tui.cli.command_line import (
    ExitCode,
    OneLineParser,
    add_flag,
    add_json_option,
    add_setting_options,
    add_trust_option,
    overrides_from,
    print_json,
    print_lines,
    report,
    subcommand,
)
from simmer_tui.config.device_trust import DeviceUse
from simmer_tui.config.importer.device_skeletons import with_skeletons
from simmer_tui.config.importer.files import read_path
from simmer_tui.config.importer.imported import check_mission
from simmer_tui.config.importer.set_writer import set_files
from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.new_set import SCHEMA_FOLDER as SCHEMAS
from simmer_tui.config.new_set import (
    enabled_codes,
    schema_path,
    term_files,
    with_comments,
    with_dialect,
    with_mission,
)
from simmer_tui.config.sensors_csv import FILE as SENSORS_FILE
from simmer_tui.config.set_document import CHECK, DIFFERENCES, problems_document, set_document
from simmer_tui.config.set_sketches import SKETCH_ENDINGS, WIRING_FILE, is_sketch_path
from simmer_tui.config.set_summary import summarize
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
    write_files,
)
from simmer_tui.config.settings import NO_WHEELS
from simmer_tui.config.settings_file import FILE as SETTINGS_FILE
from simmer_tui.dialect.frames import FrameKind
from simmer_tui.document.model import Document
from simmer_tui.errors import ConfigurationError, Problem, reason_of
from simmer_tui.sim.command import counted, typed_path


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
        if re.search(rb'^wheel = "', drafted[WIRING_FILE], re.MULTILINE) and SETTINGS_FILE in files:
            # Motors and encoders are those of wheels, which most sets do not describe.
            none, two = f'layout = "{NO_WHEELS}"'.encode(), b'layout = "diff"  # ?'
            files[SETTINGS_FILE] = files[SETTINGS_FILE].replace(none, two, 1)
    if options.term:
        files = term_files(files)
    wrote = _write(options.directory, files)
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
    print_lines(_write(options.directory, made))
    print_lines(f'Look at every line with "# ?", then: simmer-tui check {typed_path(options.directory)}')
    return ExitCode.DONE


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


def add_mission_option(parser: argparse.ArgumentParser) -> None:
    """The option `--mission` of the commands that write a set."""
    add_flag(parser, "--mission", "add a gripper, a load sensor and a mission.toml")


def _write(directory: Path, files: Mapping[str, bytes]) -> str:
    """Write the files of a set; returns a line with their names, without the schemas. Raises
    ConfigurationError."""
    written = [path.relative_to(directory) for path in write_files(directory, files)]
    names = ", ".join(path.as_posix() for path in written if path.parts[0] != SCHEMAS)
    return f"Wrote {names} to {directory}"


def _check_options(parser: OneLineParser) -> None:
    parser.add_argument(
        "directory",
        metavar="DIR",
        nargs="?",
        help="a folder, also of a course, or the name of a set (default: config, else the bundled default)",
    )
    parser.add_argument(
        "--against",
        metavar="FILE",
        type=Path,
        help="an exchange with the real robot (--record FILE): where the dialect answers otherwise",
    )
    add_trust_option(parser)
    add_json_option(parser)
    add_setting_options(parser)


@subcommand("check", _check_options, usage="simmer-tui check [DIR] [options]")
def run_check(options: argparse.Namespace) -> int:
    """Check a configuration set and show what it describes."""
    try:
        directory, overrides = find_set(options.directory), overrides_from(options)
        configuration = load(directory, overrides, devices=DeviceUse.CHECK)
        course = _course_of(Path(options.directory or ""))
        # A comparison shows the tables alone.
        wiring, problems = _sketches(configuration) if options.against is None else ([], [])
    except ConfigurationError as error:
        if not options.json:
            raise
        print_json(problems_document(error.problems))
        return ExitCode.PROBLEM
    if options.against is not None:
        return _check_against(options.against, configuration, as_json=options.json)
    if options.json:
        print_json(set_document(configuration, problems))
        return ExitCode.NO if problems else ExitCode.DONE
    text = summarize(configuration)
    try:
        # A terminal in the C locale has no characters for the drawing of the maze.
        text.encode(sys.stdout.encoding or "ascii")
    except UnicodeEncodeError:
        text = summarize(configuration, ascii_only=True)
    sys.stdout.write(text)
    if course:
        print_lines("", course)
    if wiring:
        print_lines("", *wiring)
    if problems:
        print_lines("", f"The wiring and its sketches have {counted(len(problems), 'problem')}:")
        print_lines(*(f"  {problem}" for problem in problems))
    return ExitCode.NO if problems else ExitCode.DONE


def _sketches(configuration: Configuration) -> tuple[list[str], list[Problem]]:
    """The lines about a set's wiring and boards, which run for a second, and the problems with its sketches;
    none for a set without a wiring. Raises ConfigurationError if the wiring itself has mistakes."""
    if WIRING_FILE not in configuration.files:
        return [], []
    from simmer_tui.cli.sketch_option import tell_long_build
    from simmer_tui.sketch.bench_check import bench_lines
    from simmer_tui.sketch.gripper_draft import guess_lines
    from simmer_tui.sketch.motion_check import motor_lines
    from simmer_tui.sketch.sketch_check import facts_of, sketch_problems
    from simmer_tui.sketch.wiring import wiring_lines, wiring_of

    wiring = wiring_of(configuration)
    if wiring is None:
        return [], []
    problems: list[Problem] = []
    facts, wheels = facts_of(wiring, configuration.directory, problems), configuration.simulation.wheels
    problems += sketch_problems(wiring, facts, wheels)
    guesses = guess_lines(wiring, configuration.files[WIRING_FILE])
    lines = [*wiring_lines(wiring), *guesses, *motor_lines(wiring, wheels)]
    tell_long_build()
    return [*lines, *bench_lines(configuration, wiring, problems)], problems


def _course_of(folder: Path) -> str:
    """A line about the course in a folder, empty if it has none. Raises ConfigurationError."""
    from simmer_tui.grade.course import COURSE_FILE, read_course

    file = folder / COURSE_FILE
    if not file.is_file():
        return ""
    course = read_course(folder, file, alone=True)
    return f"Course: {course.name}; a success rate of {course.require:g} passes ({COURSE_FILE})"


def _check_against(path: Path, configuration: Configuration, *, as_json: bool) -> int:
    """Print the messages that a dialect answers otherwise than its robot did. Returns the exit code."""
    from simmer_tui.config.exchange_file import read_exchange
    from simmer_tui.dialect.exchange import Comparison

    rules = configuration.dialect
    if rules is None or rules.protocol is not None:
        what = "is compared with the rules of a dialect.toml, which this set does not have"
        raise ConfigurationError([Problem("--against", what)])
    baud, pieces = read_exchange(path)
    comparison = Comparison(rules, baud)
    rows = [(each.line, each.text) for each in comparison.differences(pieces)]
    if as_json:
        ok = CHECK.filled([(not rows, configuration.name, str(configuration.directory))])
        print_json(Document("Set", [ok, DIFFERENCES.filled(rows)]))
    else:
        print_lines(*(f"{path.name}:{line}: {text}" for line, text in rows))
        found = counted(len(rows), "difference") if rows else "the dialect answers as the robot did"
        print_lines(f"{counted(comparison.messages, 'message')} of the dialect; {found}")
    return ExitCode.NO if rows else ExitCode.DONE


def _import_options(parser: OneLineParser) -> None:
    parser.add_argument("file", metavar="FILE", type=Path, help="config.py, Main.m, or the folder of either")
    parser.add_argument(
        "directory", metavar="DIR", type=Path, help="the folder to write; made if it does not exist"
    )
    add_mission_option(parser)


@subcommand("import", _import_options)
def run_import(options: argparse.Namespace) -> int:
    """Make a configuration set from a simmer-python config.py or a MATLAB Main.m. The file is read, never
    executed."""
    # Exit code 0: the set can be used. 1: it was written, but must be edited first.
    imported, skeletons = with_skeletons(read_path(options.file))
    if options.mission:
        check_mission(imported)
    files = {**set_files(imported), **skeletons}
    files = with_comments(with_mission(files) if options.mission else files)
    print_lines(_write(options.directory, files))
    if imported.left_out:
        print_lines("Not imported, or changed:", *(f"  {problem}" for problem in imported.left_out))
    try:
        # Read back as a run will read it: the team sees now what must be edited.
        load(options.directory, devices=DeviceUse.PARSE)
    except ConfigurationError as error:
        print_lines("The set needs editing before it can be used:")
        report(error)
        return ExitCode.NO
    if skeletons:
        print_lines(f"To finish: {', '.join(skeletons)} (docs/devices.md says how)")
    print_lines(f"Try it: simmer-tui --config {typed_path(options.directory)}")
    return ExitCode.DONE
