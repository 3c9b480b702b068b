"""Wheels of a robot for the draft of a wiring.toml: the layout that its motors make, and each one's wheel."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from msgspec import Struct

from simmer_tui.sim.specs import WheelLayout
from simmer_tui.sketch.motor_draft import DraftMotor
from simmer_tui.sketch.side_draft import FRONT_END, LEFT_SIDE, REAR_END, RIGHT_SIDE, PartPlace, ends_differ
from simmer_tui.sketch.sketch_scan import SketchFacts
from simmer_tui.sketch.stepper_draft import DraftStepper
from simmer_tui.sketch.wiring import WHEEL_NAMES

_SIDEWAYS = re.compile("mecan|strafe|sideway|lateral|diagonal|crab|seitw", re.IGNORECASE)
"""Words of robots that drive sideways."""
BY_NAME = "by the names in the sketch"
_CORNERS, _KIWI = len(WHEEL_NAMES[WheelLayout.MECANUM]), len(WHEEL_NAMES[WheelLayout.OMNI_3])
_CROSS = {("", FRONT_END), ("", REAR_END), (LEFT_SIDE, ""), (RIGHT_SIDE, "")}
"""The places of omni wheels in the middle of each side."""


class DraftDrive(Struct, frozen=True):
    """A motor or stepper of a board: its place by the sketch's names, and its side by its turns."""

    motor: DraftMotor | DraftStepper
    place: PartPlace
    turn: str
    facts: SketchFacts


class DraftWheel(Struct, frozen=True):
    """The wheel of a part, and the mark beside it; an empty name if there is none left."""

    name: str
    mark: str = ""


def layout_of(drives: Sequence[DraftDrive]) -> WheelLayout:
    """The layout of a robot with these motors. Four at its corners are mecanum wheels where the sketch drives
    sideways, else two wheels a side that run together."""
    places = [each.place for each in drives if each.place.is_wheel]
    told = {(each.side, each.end) for each in places}
    if len(places) == _CORNERS and told == _CROSS:
        return WheelLayout.OMNI_4
    if len(places) == _CORNERS and (any(map(_goes_sideways, drives)) or _sides_differ(drives)):
        return WheelLayout.MECANUM
    is_kiwi = len(places) == _KIWI and (told == {("", "")} or (len(told) == _KIWI and told < _CROSS))
    return WheelLayout.OMNI_3 if is_kiwi else WheelLayout.DIFF


def _goes_sideways(drive: DraftDrive) -> bool:
    facts = drive.facts
    names = (facts.file, *facts.functions, *facts.expressions, *(call.name for call in facts.calls))
    return any(_SIDEWAYS.search(name) for name in names)


def _sides_differ(drives: Sequence[DraftDrive]) -> bool:
    """True if the two wheels of a side turn against each other in a function of the only board."""
    motors = [each.motor for each in drives if isinstance(each.motor, DraftMotor)]
    has_one_board = len({each.facts.file for each in drives}) == 1
    places = [each.place for each in drives]
    return has_one_board and len(motors) == len(drives) and ends_differ(drives[0].facts, motors, places)


def layout_with(wheels: Iterable[str]) -> WheelLayout | None:
    """The first layout that has all these wheels; None without one."""
    wanted = {*wheels}
    return next((layout for layout, names in WHEEL_NAMES.items() if wanted and wanted <= {*names}), None)


class DraftWheels:
    """The wheels of motors, or of encoders: those that names tell, and of the others those that are left.

    Args:
        layout: The layout of the robot.
        places: The places of all parts.
        what: The question beside a guess.
    """

    def __init__(self, layout: WheelLayout, places: Iterable[PartPlace], what: str) -> None:
        self._names, self._what = WHEEL_NAMES[layout], what
        self.first = self._names[0]
        named = {self._named(each) for each in places}
        self._left = [each for each in self._names if each not in named]

    def next_wheel(self, place: PartPlace, turn: str = "") -> DraftWheel:
        """The wheel of the next part: by its place, or one that is left, on the side by a turn if it can."""
        if name := self._named(place):
            return DraftWheel(name, BY_NAME)
        side = place.side or turn
        for name in sorted(self._left, key=lambda each: side not in each.split("_")):
            self._left.remove(name)
            return DraftWheel(name, f"? {self._what}")
        # By a turn, all motors of a side.
        return DraftWheel(side if side in self._names else "", f"? {self._what}")

    def _named(self, place: PartPlace) -> str:
        """The wheel at a place; empty if the layout has none there, or it is not known."""
        name = "_".join(each for each in (place.end, place.side) if each)
        return next((each for each in (name, place.side) if each in self._names), "")
