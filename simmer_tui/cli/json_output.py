"""Answers as JSON, for scripts: the option `--json`, and plain values of what a command has found."""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import sys
from collections.abc import Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import Any

from msgspec import Struct, structs

from simmer_tui.errors import ConfigurationError
from simmer_tui.report.content import Table
from simmer_tui.sim.specs import SensorSpec


def add_json_option(parser: argparse.ArgumentParser) -> None:
    """The option `--json`."""
    parser.add_argument("--json", action="store_true", help="print the answer as JSON, for scripts")


def print_json(value: object) -> None:
    """Print a value as one JSON text on standard output, `plain` first."""
    sys.stdout.write(json.dumps(plain(value), indent=1, allow_nan=False) + "\n")


def plain(value: object) -> Any:
    """A value in JSON's own types: records by the names of their fields, kinds of sensor by name, and
    numbers that are not finite (a range without limit) as null."""
    if isinstance(value, Struct):
        return plain(structs.asdict(value))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {item.name: plain(getattr(value, item.name)) for item in dataclasses.fields(value)}
        return {"id": value.id, **fields} if isinstance(value, SensorSpec) else fields
    if isinstance(value, type):
        return getattr(value, "name", value.__name__)
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Mapping):
        return {str(plain(key)): plain(each) for key, each in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


def problems_of(error: ConfigurationError) -> list[dict[str, str]]:
    """The mistakes of a set, each with its place."""
    return [{"where": problem.where, "what": problem.what} for problem in error.problems]


def table_rows(table: Table) -> dict[str, Any]:
    """A table with its rows as they are shown."""
    return {"title": table.title, "columns": [each.name for each in table.columns], "rows": table.rows}
