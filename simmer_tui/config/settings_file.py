"""settings.toml and the options that override it, read into `Settings`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simmer_tui.config.csv_table import read_text
from simmer_tui.config.settings import KeySettings, Setting, Settings, all_settings, settings_from
from simmer_tui.config.toml_text import key_lines, parse_toml, place_of
from simmer_tui.errors import Problem
from simmer_tui.sim.rules import did_you_mean

FILE = "settings.toml"


@dataclass(frozen=True, slots=True)
class Override:
    """A setting given outside the file: by which option, and its value.

    Text is read as the command line gives it (`6,42`); any other type is checked as TOML's is.
    """

    option: str
    value: object


@dataclass(frozen=True, slots=True)
class LoadedSettings:
    """The settings, and for each (dotted name) the place a person would change it."""

    settings: Settings
    places: Mapping[str, str]


def load_settings(
    directory: Path, overrides: Mapping[str, Override], problems: list[Problem]
) -> LoadedSettings:
    """Read settings.toml in `directory` and lay the overrides over it.

    Mistakes go to `problems`; a setting with one keeps its default. A setting absent from the
    file has its default.
    """
    values: dict[str, Any] = {}
    known = all_settings()
    text = read_text(directory / FILE, problems)
    lines = key_lines(text) if text is not None else {}
    places = {item.name: place_of(item.name, FILE, lines) for item in known}
    if text is not None:
        given = dict(_flatten(parse_toml(text, FILE, problems), {item.name for item in known}))
        _report_unknown(given, known, lines, problems)
        for item in known:
            if item.name in given:
                _take(item, given[item.name], places[item.name], values, problems)
    for item in known:
        if item.name in overrides:
            override = overrides[item.name]
            places[item.name] = override.option
            _take(item, override.value, override.option, values, problems, is_text=True)
    _apply_seed_option(overrides, values, problems)
    _apply_serial_option(overrides, values, problems)
    _apply_keys(values)
    settings = settings_from(values)
    _check_together(settings, places, problems)
    return LoadedSettings(settings, places)


def _flatten(tree: dict[str, Any], names: set[str], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """The values by dotted name; only tables that exist are descended into."""
    for key, value in tree.items():
        name = prefix + key
        if isinstance(value, dict) and any(known.startswith(f"{name}.") for known in names):
            yield from _flatten(value, names, f"{name}.")
        else:
            yield name, value


def _report_unknown(
    given: Mapping[str, Any], known: tuple[Setting, ...], lines: Mapping[str, int], problems: list[Problem]
) -> None:
    names = {item.name for item in known}
    tables = {name.split(".")[0] for name in names if "." in name}
    full_names = {item.name.split(".")[-1]: item.name for item in reversed(known)}
    for name in given:
        if name in names:
            continue
        if name in tables:
            what = f"is a table of settings, written [{name}] on a line of its own"
        else:
            leaf = name.split(".")[-1]
            same_leaf = full_names.get(leaf)
            hint = f'; did you mean "{same_leaf}"?' if same_leaf else did_you_mean(name, names | tables)
            hint = hint or did_you_mean(leaf, full_names)
            if "." in name and same_leaf and "." not in same_leaf:
                hint += " It belongs above the first [table]."
            what = f"is not a setting{hint}"
        problems.append(Problem(place_of(name, FILE, lines), what))


def _take(
    item: Setting,
    value: object,
    place: str,
    values: dict[str, Any],
    problems: list[Problem],
    *,
    is_text: bool = False,
) -> None:
    try:
        if is_text and isinstance(value, str):
            values[item.name] = item.rule.from_text(value)
        else:
            values[item.name] = item.rule.check(value)
    except ValueError as error:
        unit = f" (unit: {item.unit})" if item.unit else ""
        problems.append(Problem(place, f"{error}{unit}"))


def _apply_seed_option(
    overrides: Mapping[str, Override], values: dict[str, Any], problems: list[Problem]
) -> None:
    """A seed given as an option is meant to be used, so it turns the unrepeatable errors off."""
    if "seed" not in overrides:
        return
    if "randerror" in overrides and values.get("randerror", False):
        problems.append(
            Problem(
                overrides["seed"].option,
                f"asks for repeatable errors and {overrides['randerror'].option} for different ones; "
                "give one of the two",
            )
        )
    values["randerror"] = False


def _apply_serial_option(
    overrides: Mapping[str, Override], values: dict[str, Any], problems: list[Problem]
) -> None:
    """A robot's port given as an option is meant to be used, so the robot is not simulated."""
    if "serial.port" not in overrides or not values.get("serial.port"):
        return
    if "sim" in overrides and values.get("sim", False):
        problems.append(
            Problem(
                overrides["serial.port"].option,
                f"asks for a real robot and {overrides['sim'].option} for the simulated one; "
                "give one of the two",
            )
        )
    values["sim"] = False


def _apply_keys(values: dict[str, Any]) -> None:
    """A key that was given to one action is no longer another's by default."""
    given = {name.removeprefix("keys."): keys for name, keys in values.items() if name.startswith("keys.")}
    if any(keys != getattr(KeySettings(), name) for name, keys in given.items()):
        from simmer_tui.config.keys import yielding_defaults  # most runs leave the keys as they are

        values.update({f"keys.{name}": keys for name, keys in yielding_defaults(given).items()})


def _check_together(settings: Settings, places: Mapping[str, str], problems: list[Problem]) -> None:
    """Checks that involve more than one value, or what this version supports."""
    if not settings.sim and not settings.serial.port:
        problems.append(
            Problem(
                places["sim"],
                "means the real robot, which needs its serial port: --serial PORT, or port in [serial] "
                "(simmer-tui ports lists them)",
            )
        )
    server = settings.server
    if server.port == server.reply_port != 0:
        problems.append(
            Problem(places["server.reply_port"], f"must differ from server.port, which is {server.port} too")
        )
    if settings.keys != KeySettings():
        from simmer_tui.config.keys import key_problems  # most runs leave the keys as they are

        problems += key_problems(settings.keys, places)
