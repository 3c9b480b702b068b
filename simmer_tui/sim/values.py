"""The description of a value: a setting, a key of a TOML file or a column of a CSV file.

Readers, options, JSON schemas, comments in new sets, reference pages, a course's rules and calibration all
use these records, so that each fact about a value is stated once.
"""

from collections.abc import Mapping
from enum import StrEnum
from typing import Any, TypeVar

from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.sim.rules import Rule


class CourseRule(StrEnum):
    """The values that a team's robot may have in place of the course's."""

    FREE = "free"
    """Any value: mounting and adjustment are the team's choice."""
    AT_LEAST = "at least"
    """The course's or more: the value of an error."""
    AT_MOST = "at most"
    """The course's or less: the value of a limit, where 0 means none."""
    SAME = "same"
    """The course's only: with a large gain, or much iron around a compass, the errors after it would be
    relatively small."""
    SHIFT = "shift"
    """The course's or more, whatever the sign; the course's only where a range is limited, because a shift
    would extend the range."""


class Value(Struct, frozen=True):
    """A value: its name in the file (a TOML key or the header of a column), and its description.

    `field` is the field of the spec that it fills, dotted for one inside another (`error.x`). `noun` is its
    name in a sentence, if that is not the field's. The kinds of sensors list the values that calibration may
    estimate, because their priors differ.
    """

    rule: Rule[Any]
    help: str = ""
    unit: str = ""
    name: str = ""
    field: str = ""
    default: Any = None
    noun: str = ""
    course: CourseRule = CourseRule.SAME

    @property
    def shown(self) -> str:
        """The name in a sentence."""
        return self.noun or self.field.replace("_", " ")

    def with_unit(self, message: str) -> str:
        """A message about the value, with its unit if it has one."""
        return f"{message} (unit: {self.unit})" if self.unit else message


S = TypeVar("S", bound=Struct)


def with_values(spec: S, values: Mapping[str, Any]) -> S:
    """A copy of a struct with other values, by field; `error.x` is the field x of its field error."""
    changed: dict[str, Any] = {}
    for name, value in values.items():
        field, _, inner = name.partition(".")
        if inner:
            value = replace(changed.get(field, getattr(spec, field)), **{inner: value})
        changed[field] = value
    return replace(spec, **changed)


def described(defaults: object) -> tuple[Value, ...]:
    """The values that the annotations of a class describe, in the order of its fields.

    Args:
        defaults: An object of the class with all defaults. The class's module must not import annotations
            from `__future__`.
    """
    return tuple(
        replace(item, name=name, field=name, default=getattr(defaults, name))
        for name, annotation in type(defaults).__annotations__.items()
        for item in getattr(annotation, "__metadata__", ())
    )
