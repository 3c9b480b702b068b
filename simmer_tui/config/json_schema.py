"""JSON schemas of settings.toml and mission.toml, made of their rules, so that editors complete and check.

A file names its schema in a comment, `#:schema .schema/settings.json`: Even Better TOML in VS Code and
taplo on the command line read that. Keywords are those of JSON Schema draft 7, which both know.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

from simmer_tui.config import mission_toml, settings_file
from simmer_tui.config.settings import Setting, all_settings
from simmer_tui.sim.values import Value

FOLDER = ".schema"
"""The folder of a set with the schemas of its files."""
_DRAFT = "http://json-schema.org/draft-07/schema#"
_DIRECTIVE = "#:schema "

Schema = dict[str, Any]


def schemas() -> dict[str, Schema]:
    """The schemas by the name of the file that each is for."""
    return {settings_file.FILE: settings_schema(), mission_toml.FILE: mission_schema()}


def schema_path(file: str) -> str:
    """The path in a set of the schema of one of its files: `.schema/settings.json`."""
    return f"{FOLDER}/{file.removesuffix('.toml')}.json"


def schema_text(schema: Schema) -> str:
    """The text of a schema's file."""
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


def naming_schema(file: str, text: str) -> str:
    """The text of a TOML file with its schema named in the first line; one named before is replaced."""
    lines = text.splitlines(keepends=True)
    rest = lines[1:] if lines and lines[0].startswith(_DIRECTIVE) else lines
    return f"{_DIRECTIVE}{schema_path(file)}\n" + "".join(rest)


def settings_schema() -> Schema:
    """The schema of settings.toml: every setting with its values, default and meaning, in its table."""
    return _schema("Settings of the simulator, SimMeR-TUI", all_settings())


def mission_schema() -> Schema:
    """The schema of mission.toml."""
    return _schema("The mission of a set, SimMeR-TUI", mission_toml.KEYS)


def _schema(title: str, values: Iterable[Value]) -> Schema:
    whole = _object(title)
    for value in values:
        table, _, key = value.name.rpartition(".")
        target = whole["properties"].setdefault(table, _object(table)) if table else whole
        parts = [f"{value.help[0].upper()}{value.help[1:]}"]
        parts += [f"Unit: {value.unit}"] if value.unit else []
        parts += [f"Option: {value.option}"] if isinstance(value, Setting) else []
        described = {"description": ". ".join(parts), "default": value.rule.plain(value.default)}
        target["properties"][key] = value.rule.schema | described
    return {"$schema": _DRAFT, **whole}


def _object(title: str) -> Schema:
    return {"title": title, "type": "object", "additionalProperties": False, "properties": {}}
