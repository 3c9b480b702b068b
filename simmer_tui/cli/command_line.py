"""Parts that all commands share: parser, options, answers, and exit codes of errors."""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Callable, Collection, Generator, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from enum import IntEnum
from functools import partial
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TextIO

from simmer_tui import platform_has
from simmer_tui.config.device_trust import OPTION, TRUST, DeviceTrust
from simmer_tui.config.mission_toml import OVERRIDDEN
from simmer_tui.config.sets import DEFAULT_SET
from simmer_tui.config.settings import Setting, all_settings, tables
from simmer_tui.config.settings_file import Override
from simmer_tui.errors import (
    ClusterError,
    ConfigurationError,
    Problem,
    ProgramError,
    SimmerError,
    printable,
    reason_of,
)
from simmer_tui.sim.command import counted, cut, keyboard_text, typed_path
from simmer_tui.sim.rules import FlagRule, Rule, did_you_mean

if TYPE_CHECKING:  # a run has no documents, and must start quickly
    from rich.console import Console

    from simmer_tui.config.device_file import DeviceFile
    from simmer_tui.document.model import Document

OptionGroup = argparse._ActionsContainer
"""A parser, or a group of its options."""

_DEST = "setting."
"""Prefix of the attributes of setting options, so that they do not clash with others."""
# Only numbers: `-x` after an option stays an option of its own.
_NEGATIVE_VALUE = re.compile(r"-[.0-9]")
_ONE_DASH = re.compile(r"-[A-Za-z]{2}")
_MISSING = re.compile(r"the following arguments are required: (.*)")
_ARGUMENT = re.compile(
    r"argument (?:-\w/)?(--[\w-]+): (expected one argument|expected at least|ignored explicit)"
)
_LONG_OPTION = re.compile(r"--[^=\s]+")
# The imports and the head of a class: enough to recognise the file.
_LINES, _WIDTH = 12, 100
"""Lines of a device file that the question shows, and characters of each."""


class ExitCode(IntEnum):
    """Exit codes of `simmer-tui`; the code of a program that is run comes before them."""

    DONE = 0
    NO = 1
    PROBLEM = 2
    LOST = 3
    # As of shells: a command that is not found, and 128 + SIGINT.
    NOT_STARTED = 127
    INTERRUPTED = 130


EXIT_CODES = {
    ExitCode.DONE: "all is well",
    ExitCode.NO: "done, but the answer is no: a mission failed, no command came from the program, a reply "
    "differs, too few trials succeed, an imported set needs editing, there is no serial port",
    ExitCode.PROBLEM: "nothing was done: a mistake in an option, a set or a log, a port that is taken",
    ExitCode.LOST: "the Dask cluster cannot be reached, or was lost: --resume continues",
    ExitCode.NOT_STARTED: "the program of --run cannot be started",
    ExitCode.INTERRUPTED: "Ctrl-C; a run without a program ends with 0",
}
"""Meanings of the exit codes, for the reference."""
EXIT_CODES_OF_RUNS = (
    "With --run it is the program's own code; 128 and the number of the signal that ended it, as in a shell. "
    "With --mission and --no-ui it is 0 if the mission succeeded, else 1, whatever the program's code."
)


_CODES: dict[type[SimmerError], ExitCode] = {
    ProgramError: ExitCode.NOT_STARTED,
    ClusterError: ExitCode.LOST,
}
"""Exit codes of some errors; all others are problems."""


def say(line: str, stream: TextIO | None = None) -> None:
    """Print a line at once, by default on standard error; a closed stream is no fault. Control characters are
    shown escaped."""
    target = stream or sys.stderr
    with suppress(OSError, ValueError):
        try:
            # One write: between a line and its end another process could write.
            target.write(f"{printable(line)}\n")
            target.flush()
        except BrokenPipeError:
            drop_output(target)


def drop_output(stream: TextIO) -> None:
    """Send the rest of a stream that nobody reads to the null device: Python writes it once more at exit, and
    ends with code 120 if that fails."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def print_lines(*lines: str) -> None:
    """Print lines on standard output, with control characters shown escaped: the answer of a command."""
    sys.stdout.write("".join(f"{printable(line)}\n" for line in lines))


def report(error: SimmerError, program: str = "simmer-tui") -> int:
    """Print an error on standard error, each problem of a configuration on its own line. Returns its exit
    code."""
    # Each problem names its own place: the program's name before it would hide that.
    for line in error.lines() if isinstance(error, ConfigurationError) else [f"{program}: {error}"]:
        say(line)
    return _CODES.get(type(error), ExitCode.PROBLEM)


@contextmanager
def writing(kind: type[SimmerError], path: Path) -> Generator[None, None, None]:
    """Inside the `with` block a file is written: raises an error of this kind, with the reason, if it cannot
    be."""
    try:
        yield
    except OSError as error:
        raise kind(f"{path} cannot be written: {reason_of(error)}") from None


def without_effect(overrides: Mapping[str, Override], varied: Collection[str] = ()) -> list[Problem]:
    """The problems with options that place robot or block in a mission, or vary their place: one of two
    places would be ignored without a word."""
    given = [overrides[name].option for name in OVERRIDDEN if name in overrides]
    given += [f"--vary {name}" for name in OVERRIDDEN if name in varied]
    what = "has no effect in a mission: mission.toml says where robot and block start"
    return [Problem(option, what) for option in given]


def has_terminal() -> bool:
    """True if there is a terminal to draw on, or `textual serve` in its place."""
    # Textual's own variable: with it Textual draws in packets over the standard streams.
    if os.environ.get("TEXTUAL_DRIVER"):
        return True
    return sys.stdin.isatty() and sys.stdout.isatty() and sys.stderr.isatty()


@dataclass(eq=False)
class CliCommand:
    """A command of `simmer-tui`: called with the arguments after its name, it returns the exit code. Errors
    of its function become messages and exit codes."""

    parser: Callable[[], OneLineParser]
    """Makes its parser, for itself, completion and the reference pages."""
    function: Callable[[argparse.Namespace], int]

    def __call__(self, argv: list[str]) -> int:
        parser = self.parser()
        try:
            options = parser.parse_args(argv)
            with _trusting(DeviceTrust(getattr(options, "trust_devices", False), _ask_on_terminal)):
                return int(self.function(options))
        except SimmerError as error:
            return report(error, parser.prog)
        except PermissionError as error:
            # In one place for all the files that a command opens.
            if error.filename is None:
                raise
            say(f"{parser.prog}: {error.filename} cannot be opened: {reason_of(error)}")
            return ExitCode.PROBLEM
        except KeyboardInterrupt:
            return ExitCode.INTERRUPTED


@contextmanager
def _trusting(trust: DeviceTrust) -> Generator[None, None, None]:
    """Trust in a team's own devices inside the `with` block: in all, or by a question."""
    token = TRUST.set(trust)
    try:
        yield
    finally:
        TRUST.reset(token)


def _ask_on_terminal(file: DeviceFile, directory: Path) -> bool:
    """True if the user types yes. Without a terminal for question and answer it is False, without a
    question."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    *lines, question = _question(file, directory)
    for line in lines:
        say(line)
    sys.stderr.write(question)
    sys.stderr.flush()
    try:
        answer = sys.stdin.readline()
    except (OSError, ValueError):
        return False
    return answer.strip().lower() in ("y", "yes")


def _question(file: DeviceFile, directory: Path) -> list[str]:
    path = str(directory / file.path)
    lines = file.text.splitlines()
    shown = [f"  {number:3} {line[:_WIDTH]}" for number, line in enumerate(lines[:_LINES], 1)]
    rest = len(lines) - len(shown)
    more = [f"      ... {counted(rest, 'line')} more: read them in an editor"] if rest > 0 else []
    return [
        f"The set contains a sensor of its own, a Python file that runs with your rights: {path}",
        f"SHA-256 {file.sha256}, {len(file.data):,} bytes",
        *shown,
        *more,
        "Trust this file, and run it from now on? A changed file is asked about again. [y/N] ",
    ]


def add_trust_option(parser: OptionGroup) -> None:
    """The option `--trust-devices`, of commands that may run a set's own devices."""
    add_flag(parser, OPTION, "run the set's devices/*.py without asking")


def asking_nobody() -> AbstractContextManager[None]:
    """Ask no question about devices inside the `with` block, while a screen has the terminal."""
    return _trusting(DeviceTrust(TRUST.get().everything))


def subcommand(
    name: str, add_options: Callable[[OneLineParser], None] | None = None, **settings: Any
) -> Callable[[Callable[[argparse.Namespace], int]], CliCommand]:
    """Make the command `simmer-tui NAME` of a function of its options, which returns the exit code. Its
    docstring is the description in its help.

    Args:
        name: The name.
        add_options: Adds its options to its parser.
        settings: Further arguments of the parser.
    """

    def made(function: Callable[[argparse.Namespace], int]) -> CliCommand:
        def parser() -> OneLineParser:
            description = " ".join((function.__doc__ or "").split())
            parser = OneLineParser(prog=f"simmer-tui {name}", description=description, **settings)
            if add_options is not None:
                add_options(parser)
            return parser

        return CliCommand(parser, function)

    return made


def _path(text: str) -> Path:
    """The path of an argument. A blank one, as of a script's variable that is not set, would be the present
    folder."""
    if not text.strip():
        raise argparse.ArgumentTypeError("the name is blank")
    return Path(text)


_CURLY = "\u2018\u2019\u201a\u201c\u201d\u201e"
"""Quotes of documents, which no shell takes for quotes."""


def _program_in_quotes(words: Sequence[str], unknown: Sequence[str]) -> str:
    """A hint for a program without quotes (`--run python my_robot.py`), if that is the mistake."""
    given = words[words.index("--run") + 1 :] if "--run" in words else []
    # An option of ours is not part of the program.
    own = list(takewhile(lambda pair: pair[0] == pair[1], zip(given[1:], unknown, strict=False)))
    program = " ".join(typed_path(word.strip(_CURLY)) for word in given[: len(own) + 1])
    return f'; the command after --run needs quotes: --run "{program}"' if own else ""


def _curly_quoted(words: Sequence[str]) -> str:
    """The option whose value begins with a curly quote, with straight ones; empty if there is none."""
    for index, word in enumerate(words):
        option, equals, value = word.partition("=") if word.startswith("-") else ("", "", word)
        if value[:1] not in _CURLY or not value:
            continue
        # The shell has split the value at its spaces.
        count = next((n for n, each in enumerate(words[index:], 1) if each[-1:] in _CURLY), 1)
        rest = " ".join([value, *words[index + 1 : index + count]]).strip(_CURLY)
        before = f"{option}{equals}" if option else "".join(f"{each} " for each in words[:index][-1:])
        return f'{before}"{rest}"'
    return ""


def _program(command: str) -> str:
    """The command of `--run`."""
    # Imported here because it takes a thirtieth of a start without a program.
    from simmer_tui.program.program_command import with_interpreter

    return with_interpreter(command)


def add_run_option(parser: OptionGroup, text: str) -> None:
    """The option `--run`, a program to be started."""
    parser.add_argument("--run", metavar='"CMD ..."', type=_program, help=text)


def add_sketch_option(parser: OptionGroup) -> None:
    """The option `--sketch`, a set whose boards drive the robot."""
    parser.add_argument("--sketch", metavar="DIR", help="as --config; sketches on its boards drive it")


class OneLineParser(argparse.ArgumentParser):
    """A parser whose errors are one line on stderr and exit code 2.

    It takes negative values after a space (`--bot-center -1,2`). It does not accept shortened options, and
    suggests the option, or one of `words`, that may have been meant.
    """

    def __init__(self, *args: Any, words: Iterable[str] = (), **kwargs: Any) -> None:
        # A shortened option would change its meaning when another one is added.
        kwargs.setdefault("allow_abbrev", False)
        super().__init__(*args, **kwargs)
        self.register("type", Path, _path)
        self._words = tuple(words)
        self.setting_groups: list[argparse._ArgumentGroup] = []
        """Groups of options of settings. There are many of them: the help of a command leaves them out."""
        self.common_settings: tuple[str, ...] = ()
        """Names of the settings that the help shows nevertheless."""

    def format_help(self) -> str:
        """Help on the command's own options, and on its common settings."""
        formatter = self._get_formatter()
        formatter.add_usage(self.usage, self._actions, self._mutually_exclusive_groups)
        formatter.add_text(self.description)
        for group in self._action_groups:
            if group not in self.setting_groups:
                self._add_section(formatter, group.title, group._group_actions)
        if self.setting_groups:
            common = {_DEST + name for name in self.common_settings}
            chosen = [action for action in self._actions if action.dest in common]
            self._add_section(formatter, "settings (simmer-tui help settings has all of them)", chosen)
            if not chosen:
                formatter.add_text("Settings are options too: simmer-tui help settings.")
        formatter.add_text(self.epilog)
        return formatter.format_help()

    def _get_formatter(self) -> argparse.HelpFormatter:
        """A formatter as wide as the window, without argparse's COLUMNS."""
        window = window_of(sys.stdout)
        if window is None:
            return super()._get_formatter()
        usual = self.formatter_class
        # Two columns less, as argparse has it.
        self.formatter_class = partial(usual, width=window[0] - 2)  # type: ignore[call-arg]
        try:
            return super()._get_formatter()
        finally:
            self.formatter_class = usual

    def format_settings(self) -> str:
        """Help on the setting options only."""
        formatter = self._get_formatter()
        for group in self.setting_groups:
            self._add_section(formatter, group.title, group._group_actions)
        return formatter.format_help()

    @staticmethod
    def _add_section(
        formatter: argparse.HelpFormatter, title: str | None, actions: Iterable[argparse.Action]
    ) -> None:
        formatter.start_section(title)
        formatter.add_arguments(actions)
        formatter.end_section()

    def parse_args(self, args: Iterable[str] | None = None, namespace: Any = None) -> Any:
        words = sys.argv[1:] if args is None else list(args)
        parsed, unknown = self.parse_known_args(words, namespace)
        if unknown:
            self._refuse(words, unknown)
        return parsed

    def _refuse(self, words: Sequence[str], unknown: Sequence[str]) -> NoReturn:
        """End with a message about words that are no options or arguments."""
        from simmer_tui.cli.mistyped import advice, is_meant  # only mistakes need it

        given = unknown[0].partition("=")[0]
        # A dash of a document or of an editor, in place of one hyphen or two.
        typed = re.sub(r"^-{1,2}", "--", keyboard_text(given)) if not given.isascii() else given
        options = [name for action in self._actions for name in action.option_strings]
        # An option as Windows' own programs have them.
        if typed.startswith("/") and f"--{typed[1:]}" in options:
            typed = f"--{typed[1:]}"
        is_option = typed.startswith("-")
        hint = did_you_mean(typed, options if is_option else self._words)
        takes_program = "--run" in options
        # An option like one of ours is that one, mistyped; a program's file may resemble a command.
        if is_option and hint and not is_meant(given):
            pass
        elif text := advice(words, unknown, self.prog, takes_program=takes_program):
            self.exit(ExitCode.PROBLEM, f"{self.prog}: {text}")
        else:
            hint = _program_in_quotes(words, unknown) or hint
        kind = "option" if is_option else "command" if self._words else "argument"
        self.error(f'unknown {kind} "{cut(unknown[0])}"{hint}')

    def parse_known_args(self, args: Iterable[str] | None = None, namespace: Any = None) -> Any:
        given = sys.argv[1:] if args is None else list(args)
        options = self._option_string_actions
        if quoted := _curly_quoted(given):
            what = "“ ” ‘ ’ are quotes of documents, which a shell does not know"
            self.exit(ExitCode.PROBLEM, f"{self.prog}: {what}: type {quoted}")
        for word in takewhile(lambda word: word != "--", given):
            # argparse reads `-help` as `-h` with the value `elp`.
            if _ONE_DASH.match(word) and f"-{word}" in options and word not in options:
                self.error(f'unknown option "{cut(word)}"; did you mean "-{cut(word)}"?')
        return super().parse_known_args(_join_negative_values(given), namespace)

    def _plain(self, message: str) -> str:
        """A message of argparse with the line to type."""
        if found := _MISSING.fullmatch(message):
            line = " ".join(
                [self.prog, *(str(each.metavar or each.dest) for each in self._get_positional_actions())]
            )
            return f"{found[1]} is missing: {line}"
        found = _ARGUMENT.match(message)
        action = self._option_string_actions.get(found[1]) if found else None
        if found is None or action is None:
            return message
        if found[2].startswith("expected"):
            return f"{found[1]} needs a value: {found[1]} {action.metavar or action.dest.upper()}"
        return f"{found[1]} takes no value: type {found[1]} alone"

    def error(self, message: str) -> NoReturn:
        # One line: argparse would print the usage of all options first.
        self.exit(2, f"{self.prog}: {self._plain(message)} (see {self.prog} --help)")

    def exit(self, status: int = 0, message: str | None = None) -> NoReturn:
        if message:
            say(message)
        sys.exit(status)


def _join_negative_values(args: Sequence[str]) -> list[str]:
    """The arguments with `--bot-center`, `-1,2` joined to one; argparse alone takes `-1,2` for an option."""
    joined: list[str] = []
    for position, arg in enumerate(args):
        if arg == "--":
            return joined + list(args[position:])
        if joined and _NEGATIVE_VALUE.match(arg) and _LONG_OPTION.fullmatch(joined[-1]):
            joined[-1] += f"={arg}"
        else:
            joined.append(arg)
    return joined


def add_setting_options(
    parser: OneLineParser, *, has_screen: bool = False, names: Sequence[str] = ()
) -> None:
    """Give `parser` one option for every setting, or for those with some `names`, in groups. Those of screen,
    keys and page are only for a command that `has_screen`. The loader checks the values."""
    groups: dict[str, argparse._ArgumentGroup] = {}
    on_screen = {name for name, table in tables().items() if table.is_of_screen}
    for item in all_settings():
        if (item.group in on_screen and not has_screen) or (names and item.name not in names):
            continue
        if item.group not in groups:
            groups[item.group] = parser.add_argument_group(item.group)
        _add_option(groups[item.group], item)
    parser.setting_groups = [] if names else list(groups.values())


def add_flag(parser: OptionGroup, option: str, text: str, **settings: Any) -> None:
    """Add an option without a value. `settings` are further arguments of `add_argument`."""
    parser.add_argument(option, action="store_true", help=text, **settings)


def add_value(
    parser: OptionGroup, option: str, rule: Rule[Any], text: str, *, metavar: str = "", **settings: Any
) -> None:
    """Add an option whose values follow a rule; the rule has the usual `metavar`. `settings` are further
    arguments of `add_argument`."""

    def value(given: str) -> object:
        try:
            return rule.from_text(given)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    parser.add_argument(option, metavar=metavar or rule.metavar, type=value, help=text, **settings)


def _add_option(group: argparse._ArgumentGroup, item: Setting) -> None:
    unit = f"{item.unit}, " if item.unit else ""
    help_text = f"{item.help} ({unit}default {default_text(item) or 'none'})".replace("%", "%%")
    value: dict[str, Any] = {"metavar": item.metavar}
    if isinstance(item.rule, FlagRule):
        value = {"action": argparse.BooleanOptionalAction}
    elif item.alone:
        value |= {"nargs": "?", "const": item.alone}
    # Absent unless given: a value of the set must override a default.
    group.add_argument(
        item.option, dest=_DEST + item.name, default=argparse.SUPPRESS, help=help_text, **value
    )


def default_text(item: Setting) -> str:
    """The default as it is typed; of a flag, `on` or `off`."""
    if isinstance(item.default, bool):
        return "on" if item.default else "off"
    if isinstance(item.default, tuple):
        return ",".join(each if isinstance(each, str) else f"{each:g}" for each in item.default)
    return f"{item.default:g}" if isinstance(item.default, float) else str(item.default)


def overrides_from(namespace: argparse.Namespace) -> dict[str, Override]:
    """The settings given as options, by dotted name."""
    overrides = {}
    for item in all_settings():
        value = getattr(namespace, _DEST + item.name, None)
        if value is not None:
            # Messages name the option as it was typed.
            option = f"--no-{item.option.removeprefix('--')}" if value is False else item.option
            overrides[item.name] = Override(option, value)
    if "server.token" in overrides:
        from simmer_tui.cli.access_token import hide_from_command_line

        hide_from_command_line(str(overrides["server.token"].value))
    return overrides


def add_json_option(parser: argparse.ArgumentParser) -> None:
    """The option `--json`."""
    add_flag(parser, "--json", "print the answer as JSON, for scripts")


def add_config_option(parser: OptionGroup, default: str = f"./config, else {DEFAULT_SET}") -> None:
    """The option `--config`; `default` says which set is taken without it."""
    parser.add_argument(
        "--config",
        metavar="DIR",
        help=f"configuration set: a folder, or the name of a bundled one (default: {default})",
    )


def print_answer(document: Document, *, as_json: bool = False) -> None:
    """Print a document on standard output."""
    if as_json:
        print_json(document)
        return
    # Imported here because JSON and most commands need no rich.
    from simmer_tui.document.as_terminal import print_document

    print_document(document, window_console())


def window_of(stream: TextIO | None) -> tuple[int, int] | None:
    """Columns and rows of the terminal that a stream goes to; None if it goes to none."""
    try:
        return None if stream is None else platform_has.window_size(stream.fileno())
    except (OSError, ValueError):  # no file of the system's, or a closed one
        return None


def window_console(*, stderr: bool = False) -> Console:
    """A console of rich on a standard stream, as wide as the window. COLUMNS and LINES, which may be those of
    another window, count only where there is none."""
    from rich.console import Console

    ignored = ("COLUMNS", "LINES") if window_of(sys.stderr if stderr else sys.stdout) else ()
    return Console(
        stderr=stderr, _environ={name: value for name, value in os.environ.items() if name not in ignored}
    )


def print_json(document: Document) -> None:
    """Print a document as one JSON text on standard output."""
    from simmer_tui.document.as_data import json_text

    sys.stdout.write(json_text(document))
