"""The form of a line: how a record is made of an event, and the event of the record again.

A record says it once, in its own definition. A field is the event's attribute of the same name, unless `At`
names another one:

    believed: Annotated[LoggedPose, At("pose", POSE_FORM)]
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from enum import StrEnum
from operator import attrgetter
from typing import Any, Generic, NamedTuple, TypeVar, get_type_hints

from msgspec import Struct
from msgspec.structs import fields

from simmer_tui.sim.arcs import Twist
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import Axes

_Record = TypeVar("_Record", bound=Struct)
Values = dict[str, Any]
"""Keyword arguments, those of parts in dictionaries of their own."""
Makers = Mapping[str, Callable[[Values, Any], Any]]
"""Functions that make a part of an event, by its name. Each is called with the values of the event so far and
with those of the part."""


class ValueForm(NamedTuple):
    """A value that a record holds in another form than its event; `missing` is that of an event whose record
    leaves it out."""

    written: Callable[[Any], Any]
    read: Callable[[Any], Any]
    missing: Any = None


class At(Struct, frozen=True):
    """The place of a record's field in its event.

    Attributes:
        path: The attribute, such as `command.text`. Empty for a field that the writer is given.
        form: The form of a value that is not None.
        unless: Another field of the record. A value that repeats it is left out.
    """

    path: str
    form: ValueForm | None = None
    unless: str = ""


GIVEN = At("")
"""Marks a field that the event does not have: the writer is given it."""


class NotFinite(StrEnum):
    """The numbers that JSON lacks. `float()` turns one back into a number."""

    INFINITY = "inf"
    MINUS_INFINITY = "-inf"
    NAN = "nan"


def logged_number(value: float) -> float | NotFinite:
    """A number as a record holds it: msgspec would write those that are not finite as null."""
    return value if abs(value) < math.inf else NotFinite(str(float(value)))


logged_pose: Callable[[Any], tuple[float, float, float]] = attrgetter("x", "y", "heading")
"""A pose, or that of a block, as a record holds it."""


NUMBER_FORM = ValueForm(logged_number, float)
"""A number that may be infinite or NaN."""
POSE_FORM = ValueForm(logged_pose, lambda value: Pose(*value))
TWIST_FORM = ValueForm(lambda twist: (twist.x, twist.y, twist.r), lambda value: Twist(*value))
AXES_FORM = ValueForm(lambda axes: (axes.x, axes.y, axes.r), lambda value: Axes(*value))
ENDLESS = ValueForm(lambda time: None if time == math.inf else time, float, math.inf)
"""A time that is left out if it never comes."""


def form_of_part(record: type[Struct], part: Callable[..., Any]) -> ValueForm:
    """The form of a part of an event that has a record of its own."""
    return ValueForm(
        lambda value: line_form(record).record(value), lambda value: part(**line_form(record).values(value))
    )


class LineForm(Generic[_Record]):
    """The form of one kind of record, by its definition."""

    def __init__(self, record: type[_Record]) -> None:
        hints, given = get_type_hints(record, include_extras=True), getattr(record, "given", ())
        told = [(each.name, _at(each.name, hints[each.name])) for each in fields(record)]
        told = [(name, at) for name, at in told if at is not GIVEN and name not in given]
        self._record = record
        self._names = tuple(name for name, _ in told)
        self._of_record = _getter(self._names)
        self._of_event = _getter([at.path for _, at in told])
        self._forms = [(name, at.form) for name, at in told if at.form is not None]
        self._unless = [(name, at.unless) for name, at in told if at.unless]
        self._read = [(at.form, at.path.split(".")[:-1], at.path.split(".")[-1]) for _, at in told]
        # msgspec leaves out a field that holds the same object as its default, not one that is only equal.
        self._defaults = [
            (each.name, each.default)
            for each in fields(record)
            if each.name in self._names and type(each.default) in (float, str)
        ]

    def record(self, event: Any, known: Mapping[str, Any] | None = None, **given: Any) -> _Record:
        """The record of an event.

        Args:
            event: The event.
            known: Values of fields that a reader knows already. A field that repeats its one is left out.
            given: Values of fields that the event does not have.
        """
        values = dict(zip(self._names, self._of_event(event), strict=True))
        for name, form in self._forms:
            if values[name] is not None:
                values[name] = form.written(values[name])
        values.update(given)
        # In the order of the fields: `before` repeats `pose`, which may itself be left out.
        for name, other in self._unless:
            if values[name] == values[other]:
                values[name] = None
        if known is not None:
            for name, value in known.items():
                if values[name] == value:
                    values[name] = None
        for name, default in self._defaults:
            if values[name] == default:
                values[name] = default
        return self._record(**values)

    def values(self, record: _Record, makers: Makers | None = None) -> Values:
        """The keyword arguments of the event of a record that leaves out nothing but its defaults.

        Args:
            record: The record.
            makers: Functions that make the event's parts; a part without one is a dictionary.
        """
        found: Values = {}
        for value, (form, parts, last) in zip(self._of_record(record), self._read, strict=True):
            if form is not None:
                value = form.missing if value is None else form.read(value)
            place = found
            for part in parts:
                place = place.setdefault(part, {})
            # Of two fields for one attribute the record has one.
            if value is not None or last not in place:
                place[last] = value
        for part, maker in (makers or {}).items():
            if part in found:
                found[part] = maker(found, found[part])
        return found


_FORMS: dict[type, LineForm[Any]] = {}


def line_form(record: type[_Record]) -> LineForm[_Record]:
    """The form of a kind of record, made at its first use."""
    if record not in _FORMS:
        _FORMS[record] = LineForm(record)
    return _FORMS[record]


def _at(name: str, hint: Any) -> At:
    marks: Iterable[Any] = getattr(hint, "__metadata__", ())
    return next((each for each in marks if isinstance(each, At)), At(name))


def _getter(paths: Iterable[str]) -> Callable[[Any], tuple[Any, ...]]:
    found = tuple(paths)
    get = attrgetter(*found)
    return get if len(found) > 1 else lambda source: (get(source),)
