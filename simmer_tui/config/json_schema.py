"""JSON schemas of settings.toml and mission.toml, made of their rules, so that editors complete and check.

A file names its schema in a comment, `#:schema .schema/settings.json`: Even Better TOML in VS Code and
taplo on the command line read that. Keywords are those of JSON Schema draft 7, which both know.
"""

from __future__ import annotations

import json
from typing import Any

from simmer_tui.config import mission_toml, settings_file
from simmer_tui.config.mission_toml import MissionSpec
from simmer_tui.config.settings import all_settings

FOLDER = ".schema"
"""The folder of a set with the schemas of its files."""
_DRAFT = "http://json-schema.org/draft-07/schema#"
_DIRECTIVE = "#:schema "

Schema = dict[str, Any]


def schemas() -> dict[str, Schema]:
    """The schemas by the name of the file that each is for."""
    return {settings_file.FILE: settings_schema(), mission_toml.FILE: mission_schema()}


def schema_path(file: str) -> str:
    """Where in a set the schema of one of its files is: `.schema/settings.json`."""
    return f"{FOLDER}/{file.removesuffix('.toml')}.json"


def schema_text(schema: Schema) -> str:
    """A schema as it is written."""
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


def naming_schema(file: str, text: str) -> str:
    """The text of a TOML file with its schema named in the first line; one named before is replaced."""
    lines = text.splitlines(keepends=True)
    rest = lines[1:] if lines and lines[0].startswith(_DIRECTIVE) else lines
    return f"{_DIRECTIVE}{schema_path(file)}\n" + "".join(rest)


def settings_schema() -> Schema:
    """That of settings.toml: every setting with its values, default and meaning, in its table."""
    whole = _object("Settings of the simulator, SimMeR-TUI")
    for item in all_settings():
        table, _, key = item.name.rpartition(".")
        target = whole
        if table:
            target = whole["properties"].setdefault(table, _object(item.group))
        unit = f" Unit: {item.unit}." if item.unit else ""
        described = f"{item.help[0].upper()}{item.help[1:]}.{unit} Option: {item.option}"
        target["properties"][key] = item.rule.schema | {
            "description": described,
            "default": list(item.default) if isinstance(item.default, tuple) else item.default,
        }
    return {"$schema": _DRAFT, **whole}


def mission_schema() -> Schema:
    """That of mission.toml."""
    whole = _object("The mission of a set, SimMeR-TUI")
    defaults = MissionSpec()
    for key, (rule, meaning) in mission_toml.KEYS.items():
        default = getattr(defaults, key)
        whole["properties"][key] = rule.schema | {
            "description": f"{meaning[0].upper()}{meaning[1:]}",
            "default": mission_toml.ANY if default is None else default,
        }
    return {"$schema": _DRAFT, **whole}


def _object(title: str) -> Schema:
    return {"title": title, "type": "object", "additionalProperties": False, "properties": {}}
