"""Command-line options of the settings, and the parser all commands use."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterable, Sequence
from typing import Any, NoReturn

from simmer_tui.config.settings import Setting, all_settings
from simmer_tui.config.settings_file import Override
from simmer_tui.sim.command import escape
from simmer_tui.sim.rules import FlagRule, did_you_mean

_DEST = "setting."
"""Prefix of the attributes of setting options, so that they meet no others."""
_NEGATIVE_VALUE = re.compile(r"-[.0-9]")
_LONG_OPTION = re.compile(r"--[^=\s]+")


class OneLineParser(argparse.ArgumentParser):
    """A parser whose errors are one line on stderr and exit code 2.

    It takes negative values after a space (`--bot-center -1,2`), does not guess at shortened
    options, and suggests the option, or which of `words`, may have been meant.
    """

    def __init__(self, *args: Any, words: Iterable[str] = (), **kwargs: Any) -> None:
        kwargs.setdefault("allow_abbrev", False)
        super().__init__(*args, **kwargs)
        self._words = tuple(words)

    def parse_args(self, args: Iterable[str] | None = None, namespace: Any = None) -> Any:
        parsed, unknown = self.parse_known_args(args, namespace)
        if unknown:
            given = unknown[0].partition("=")[0]
            options = [name for action in self._actions for name in action.option_strings]
            hint = did_you_mean(given, options if given.startswith("-") else self._words)
            self.error(f'unknown argument "{escape(unknown[0], 60)}"{hint}')
        return parsed

    def parse_known_args(self, args: Iterable[str] | None = None, namespace: Any = None) -> Any:
        given = sys.argv[1:] if args is None else list(args)
        return super().parse_known_args(_join_negative_values(given), namespace)

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {escape(message, 300)} (see {self.prog} --help)\n")


def _join_negative_values(args: Sequence[str]) -> list[str]:
    """`--bot-center`, `-1,2` as one argument; argparse alone takes `-1,2` for an option."""
    joined: list[str] = []
    for position, arg in enumerate(args):
        if arg == "--":
            return joined + list(args[position:])
        if joined and _NEGATIVE_VALUE.match(arg) and _LONG_OPTION.fullmatch(joined[-1]):
            joined[-1] += f"={arg}"
        else:
            joined.append(arg)
    return joined


def add_setting_options(parser: argparse.ArgumentParser) -> None:
    """Give `parser` one option for every setting, in groups. Values are judged by the loader."""
    groups: dict[str, argparse._ArgumentGroup] = {}
    for item in all_settings():
        if item.group not in groups:
            groups[item.group] = parser.add_argument_group(item.group)
        _add_option(groups[item.group], item)


def _add_option(group: argparse._ArgumentGroup, item: Setting) -> None:
    unit = f"{item.unit}, " if item.unit else ""
    help_text = f"{item.help} ({unit}default {default_text(item) or 'none'})".replace("%", "%%")
    dest = _DEST + item.name
    if isinstance(item.rule, FlagRule):
        group.add_argument(
            item.option,
            dest=dest,
            action=argparse.BooleanOptionalAction,
            default=argparse.SUPPRESS,
            help=help_text,
        )
    else:
        group.add_argument(
            item.option, dest=dest, default=argparse.SUPPRESS, metavar=item.metavar, help=help_text
        )


def default_text(item: Setting) -> str:
    """The default as one would type it; of a flag, `on` or `off`."""
    if isinstance(item.default, bool):
        return "on" if item.default else "off"
    if isinstance(item.default, tuple):
        return ",".join(each if isinstance(each, str) else f"{each:g}" for each in item.default)
    return f"{item.default:g}" if isinstance(item.default, float) else str(item.default)


def overrides_from(namespace: argparse.Namespace) -> dict[str, Override]:
    """The settings really given as options, by dotted name."""
    given = vars(namespace)
    overrides = {}
    for item in all_settings():
        if _DEST + item.name in given:
            value = given[_DEST + item.name]
            option = f"--no-{item.option.removeprefix('--')}" if value is False else item.option
            overrides[item.name] = Override(option, value)
    return overrides
