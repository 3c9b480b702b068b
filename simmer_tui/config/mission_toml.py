"""mission.toml, the optional file of a set with the robot's task.

Annotations are evaluated here: they contain the descriptions of the keys.
"""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

from msgspec import Struct

from simmer_tui.config.toml_file import TomlFile
from simmer_tui.errors import Problem
from simmer_tui.sim.rules import IntegerRule, NumberRule, PairRule, WordOrRule
from simmer_tui.sim.values import Value, described

FILE = "mission.toml"
_ANY = "any"


class Heading(StrEnum):
    """Start headings that are drawn: a multiple of 90 degrees, or any at all."""

    QUARTER = "quarter"
    ANY = "any"


_PLACE = WordOrRule((_ANY,), (None,), other=PairRule())
_HEADING = WordOrRule(tuple(each.value for each in Heading), tuple(Heading), other=NumberRule())
_NUMBER_OF_CONTACTS = WordOrRule((_ANY,), (None,), other=IntegerRule(0, 1_000_000))


class MissionSpec(Struct, frozen=True, kw_only=True):
    """mission.toml: fetch the block and set it down in the drop zone.

    Places are in inches, global; None means one that is drawn for every run. The `start` is then the middle
    of a cell of value 2. The `block` is anywhere in the cells of value 3, with `clearance` inches between it
    and any wall. The `drop_zone` is a cell of value 2, if possible not the start's. A given `drop_zone` is
    the cell around that place. `time_limit` is in simulated seconds. `contacts` is the allowed number of
    contacts with a wall, None for any.
    """

    start: Annotated[
        tuple[float, float] | None,
        Value(_PLACE, "start of the robot's centre, inches; any: the middle of any cell of value 2"),
    ] = None
    heading: Annotated[
        float | Heading,
        Value(_HEADING, "start heading, degrees; quarter: any multiple of 90; any: any at all", "deg"),
    ] = Heading.QUARTER
    block: Annotated[
        tuple[float, float] | None,
        Value(_PLACE, "place of the block's centre, inches; any: anywhere in the cells of value 3"),
    ] = None
    clearance: Annotated[
        float,
        Value(NumberRule(0), "least distance between a block that lies anywhere and a wall, inches", "in"),
    ] = 1.0
    drop_zone: Annotated[
        tuple[float, float] | None,
        Value(
            _PLACE,
            "drop zone: the cell around this place; any: a cell of value 2 but the start's",
        ),
    ] = None
    time_limit: Annotated[
        float, Value(NumberRule(0, low_open=True), "simulated time for the mission, seconds", "s")
    ] = 300.0
    contacts: Annotated[int | None, Value(_NUMBER_OF_CONTACTS, "contacts with a wall that are allowed")] = 0


KEYS = described(MissionSpec())
"""The keys of the file."""
OVERRIDDEN = ("bot_center", "bot_rot", "block_center")
"""Settings that a mission overrides."""


def load_mission(directory: Path, problems: list[Problem]) -> tuple[MissionSpec | None, TomlFile]:
    """Read mission.toml, if there is one, and the file with the places of its keys; mistakes go to
    `problems`."""
    path = directory / FILE
    if not path.exists():
        return None, TomlFile(FILE, "", problems)
    file = TomlFile.read(path, problems)
    return MissionSpec(**file.values(KEYS)), file
