"""The text of settings.toml: every setting with its value, and a comment made of its description."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from simmer_tui.config.settings import Setting, all_settings

_TABLE = re.compile(r"\[\s*(\w+)\s*\]")
_FIRST = "# Settings of the simulator. Every one has a command-line option too, and the option wins."
_NONE: Mapping[str, Any] = MappingProxyType({})


def settings_text(values: Mapping[str, Any]) -> str:
    """settings.toml with every setting, `values` (by dotted name) in place of the defaults. Raises KeyError
    for a name that is no setting."""
    known = {item.name for item in all_settings()}
    for name in values:
        if name not in known:
            raise KeyError(name)
    return with_all_settings(f"{_FIRST}\n", values)


def with_all_settings(text: str, values: Mapping[str, Any] = _NONE) -> str:
    """A settings.toml with the settings that it lacks at the end of their tables, so that a new setting needs
    no line in the bundled sets. A text that is no TOML, or lacks nothing, stays to the letter."""
    try:
        tree = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return text
    sections: dict[str, list[str]] = {"": []}
    table = ""
    for line in text.splitlines():
        header = _TABLE.match(line)
        table = header[1] if header else table
        sections.setdefault(table, []).append(line)
    missing = [item for item in all_settings() if not _is_there(item, tree, sections)]
    for item in missing:
        table, _, key = item.name.rpartition(".")
        lines = sections.setdefault(table, [f"[{table}]"])
        while lines[-1:] == [""]:
            lines.pop()
        lines += [] if lines == [f"[{table}]"] else [""]
        lines += [_comment(item), f"{key} = {_toml(values.get(item.name, item.default))}"]
    if not missing:
        return text
    return "\n\n".join("\n".join(lines).rstrip() for lines in sections.values()) + "\n"


def _is_there(item: Setting, tree: Mapping[str, Any], sections: Mapping[str, list[str]]) -> bool:
    """True if a file has a setting, or has its table in a form to which no line can be added."""
    table, _, key = item.name.rpartition(".")
    inside = tree.get(table, {}) if table else tree
    return key in inside or (table in tree and table not in sections)


def _comment(item: Setting) -> str:
    unit = f", {item.unit}" if item.unit else ""
    return f"# {item.help[0].upper()}{item.help[1:]}: {item.rule.allowed}{unit}."


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, tuple | list):
        return f"[{', '.join(_toml(item) for item in value)}]"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return f'"{escaped}"'
    return repr(value)
