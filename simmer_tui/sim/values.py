"""The description of a value: a setting, a key of a TOML file or a column of a CSV file.

Readers, options, JSON schemas, comments in new sets, reference pages, a course's rules and calibration
all ask these records, so that each fact about a value is said once.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Any

from msgspec import Struct

from simmer_tui.sim.rules import Rule


class CourseRule(StrEnum):
    """The values that a team's robot may have in place of the course's."""

    FREE = "free"
    """Any: it says how a part is mounted or adjusted, which is the team's."""
    AT_LEAST = "at least"
    """The course's or more: the value of an error."""
    AT_MOST = "at most"
    """The course's or less: the value of a limit, where 0 stands for none."""
    SAME = "same"
    """The course's only: with a great gain, or much iron around a compass, the errors that come after it
    are small."""
    SHIFT = "shift"
    """The course's or more, whatever the sign; the course's only where a range is limited, because a shift
    brings into it what lies beyond."""


class Prior(Struct, frozen=True, kw_only=True):
    """The belief about a parameter before any data, for calibration.

    `sort` is the kind of parameter: `bias`, `gain`, `angle`, `drift` or `error`. The prior is normal
    around the value in the set with a standard deviation `spread`, in `unit`. Of an `error`, the standard
    deviation of a random error, the logarithm is normal instead; `usual` is its centre where the set
    has 0. With `relative`, the spread is multiplied by the value itself.
    """

    sort: str
    spread: float
    unit: str = ""
    label: str = ""
    usual: float = 0.0
    relative: bool = False


class Value(Struct, frozen=True):
    """A value: its name in the file (a TOML key or the header of a column), and all there is to know of it.

    `field` is the field of the spec that it fills, dotted for one inside another (`error.x`). `noun` is
    its name in a sentence, if that is not the field's. `estimated` is set where calibration may estimate it.
    """

    rule: Rule[Any]
    help: str = ""
    name: str = ""
    unit: str = ""
    default: Any = None
    field: str = ""
    noun: str = ""
    estimated: Prior | None = None
    course: CourseRule = CourseRule.SAME

    @property
    def shown(self) -> str:
        """The name in a sentence."""
        return self.noun or self.field.replace("_", " ")
