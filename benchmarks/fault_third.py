"""A third table of faults: mistakes that students make with robots and programs of this course.

    python benchmarks/faults.py --table third

The other two tables do not have these kinds. All expected answers here were written before the first run, and
none was changed. One kind is left out since: a second program beside the first, which the simulator refuses.

The common grounds are those of `fault_kinds.py`. A program that misreads its sensors leaves the same log as a
change on the wire, so the same answers count for it.

Several faults are edits of a program's own lines, as a student would have written them: `Case.edits`.
"""

from __future__ import annotations

import random

from fault_answers import (
    APART,
    CLEARANCE,
    ENDED,
    EXPLAINED,
    LOCALIZING,
    LOST,
    MISSED,
    NOT_DONE,
    NOWHERE,
    PLAIN,
    RANGES,
    SLOW,
    STEP6,
    STEP7,
    STUCK,
    UNREAD,
    UNSURE,
    Answer,
    Case,
    Expected,
    Fault,
    Hand,
    devices,
    says,
)
from fault_devices import NOBODY, in_set, on_wire, sensor_cell
from fault_people import PERSON

COUNTERS = ("o1", "o2", "o3", "o4", "g1")
BY_KEYS = (*PERSON, "keys", "console", "typed")
_HAPPENED = (NOWHERE, ENDED, SLOW, MISSED, CLEARANCE, UNREAD, STUCK)
"""True of the log, if without its reason."""


# -- the program ------------------------------------------------------------------------------


def one_behind(draw: random.Random) -> Case:
    """It reads its answers one late: each reading is the one before it, of whatever sensor. Every sensor is
    concerned, so any of them is right; a drive is not."""
    return Case(on_wire((*RANGES, *COUNTERS, "c1", "l1")), program={"readings": "one behind"})


def drives_twice(draw: random.Random) -> Case:
    """A timeout that is too short: every third drive is sent again, and both are done. The log has the same
    command twice in a row. That nothing was read between them is true, and half of it."""
    drives = devices("d1", "w1", "r1")
    right: tuple[Answer, ...] = (
        says(words=("twice", "repeated", "same command", "sent again")),
        says(APART, culprits=NOBODY),
        says(APART, culprits=drives, others=True),
        says(*EXPLAINED, culprits=drives),
    )
    partly = (says(APART), says(LOST, UNSURE, *_HAPPENED, culprits=NOBODY))
    return Case(Expected(right, partly), program={"twice": 3})


def gyro_in_a_byte(draw: random.Random) -> Case:
    """It keeps the gyro's angle in a byte, which begins again at 256 degrees."""
    return Case(on_wire(("g1",)), program={"readings": "byte", "codes": ["g1"]})


def wall_missing(draw: random.Random) -> Case:
    """Its map lacks one wall: the robot, its sensors and its drives do all that they should. A log cannot
    know of the map, but that the program was wrong while every reading was right."""
    row, column, line = draw.choice(
        (
            (1, 2, "    (3, 3, 0, 1, 1, 1, 1, 1),"),
            (2, 1, "    (1, 0, 2, 0, 0, 1, 0, 1),"),
            (2, 4, "    (1, 0, 2, 0, 0, 1, 0, 1),"),
        )
    )
    digit = 5 + 3 * column
    edit = ("plain_mission.py", line, f"{line[:digit]}1{line[digit + 1 :]}")
    right = (says(LOST, UNSURE, culprits=NOBODY), says(APART, culprits=NOBODY), says(words=("map",)))
    partly = (says(APART), says(*_HAPPENED, culprits=NOBODY))
    return Case(Expected(right, partly), edits=(edit,), opened=(row, column))


def few_particles(draw: random.Random) -> Case:
    """Its particle filter has far too few particles: sure of the wrong place, or never sure, while all
    readings are right."""
    edits = (("step4_particle_filter.py", "MANY, FEW = 8000, 800", "MANY, FEW = 120, 40"),)
    right = (says(LOST, UNSURE, culprits=NOBODY), says(APART, culprits=NOBODY))
    partly = (says(APART), says(*_HAPPENED, culprits=NOBODY))
    return Case(Expected(right, partly), edits=edits)


def old_after_turns(draw: random.Random) -> Case:
    """The first range of each sensor after a turn is the one from before it, as from a thread that reads in
    the background."""
    return Case(on_wire(RANGES), program={"readings": "old after turns", "codes": RANGES})


def grips_early(draw: random.Random) -> Case:
    """It closes the gripper 3 in before the place where it could take the block."""
    edits = (
        ("step6_block.py", 'move("d1", left - GAP)', 'move("d1", left - GAP - 3.0)'),
        ("solve.py", "- self.pilot.place))) - self.grip)", "- self.pilot.place))) - self.grip - 3.0)"),
        ("plain_mission.py", "else gap) - GAP)", "else gap) - GAP - 3.0)"),
    )
    partly = (says(MISSED), says(ENDED, NOWHERE, SLOW, APART, culprits=NOBODY))
    return Case(Expected((says(MISSED, culprits=NOBODY),), partly), edits=edits)


def averaged(draw: random.Random) -> Case:
    """It takes the mean of u1 and u3, which look ahead and back, for both."""
    return Case(on_wire(("u1", "u3")), program={"readings": "mean", "codes": ["u1", "u3"]})


def sleeps(draw: random.Random) -> Case:
    """It sleeps for 5 s after each drive: the time is used up by waiting, which is to be said."""
    right = says(SLOW, culprits=NOBODY, words=("wait", "sleep", "pause"))
    return Case(Expected((right,), (says(SLOW, NOWHERE),)), program={"sleep": 5})


def whole_numbers(draw: random.Random) -> Case:
    """Its commands are integers: 0.9 in is 0, and what is left is never driven."""
    codes = ("d1", "w1", "r1")
    rule = {"on": "command", "codes": codes, "do": "whole"}
    return Case(on_wire(codes, says(ENDED, culprits=NOBODY)), rules=(rule,))


def decimal_comma(draw: random.Random) -> Case:
    """It writes 3,5 for 3.5, and does not look at the answer: each such command is refused. That is to be
    named, or that the commands of the drives were not carried out."""
    right = (
        says(words=("refused",)),
        says(NOT_DONE, culprits=NOBODY),
        says(NOT_DONE, culprits=devices("d1", "w1", "r1")),
    )
    partly = (says(NOT_DONE, APART), says(LOST, UNSURE, *_HAPPENED, culprits=NOBODY))
    return Case(Expected(right, partly), program={"comma": True})


def cell_corners(draw: random.Random) -> Case:
    """It takes the corners of cells for their centres: it knows where it is, and goes to places that are
    walls. That it came too close, while its sensors had shown them, is as much as a log can tell."""
    edits = (
        ("step5_planning.py", "return (np.array(cell) + 0.5) * CELL", "return np.array(cell) * CELL"),
        ("plain_mission.py", "(cell[0] + 0.5) * CELL, (cell[1] + 0.5)", "cell[0] * CELL, cell[1]"),
    )
    right = (says(APART, CLEARANCE, culprits=NOBODY), says(words=("map",)))
    partly = (says(APART), says(LOST, UNSURE, *_HAPPENED, culprits=NOBODY))
    return Case(Expected(right, partly), edits=edits)


# -- on the wire ------------------------------------------------------------------------------


def loose_after_turns(draw: random.Random) -> Case:
    """The plug of the range sensors is loose and shakes in turns: the first two readings of each are 1 in
    then."""
    return Case(on_wire(RANGES), program={"readings": "loose after turns", "codes": RANGES})


def slips_backwards(draw: random.Random) -> Case:
    """The encoder of the right wheel slips when it rolls back: it counts a third of that."""
    return Case(on_wire(("o4",)), program={"readings": "one way", "codes": ["o4"]})


def battery(draw: random.Random) -> Case:
    """The battery fades: each drive and turn is 1.5 % shorter than the one before it, down to a
    twentieth."""
    codes = ("d1", "w1", "r1")
    return Case(on_wire(codes), rules=({"on": "command", "codes": codes, "do": "fade", "value": 0.015},))


# -- in the set -------------------------------------------------------------------------------


def mounted_low(draw: random.Random) -> Case:
    """u1 is mounted so low that it sees the block, over which the program believes it to look."""
    return Case(in_set("u1"), cells=(sensor_cell("u1", "Z Position (in)", 2),))


def hard_iron(draw: random.Random) -> Case:
    """A magnet beside the compass: it errs by up to 70 degrees, by the heading."""
    return Case(in_set("c1"), cells=(sensor_cell("c1", "Hard Iron (deg)", 70),))


def blind_nearby(draw: random.Random) -> Case:
    """All range sensors read 8 in for anything that is nearer."""
    return Case(in_set(*RANGES), cells=tuple(sensor_cell(code, "Min Range (in)", 8) for code in RANGES))


# -- people -----------------------------------------------------------------------------------


def drives_by_keys(draw: random.Random) -> Case:
    """A person presses a key, by which the robot turns while the program drives it."""
    hand = Hand("keys", at=draw.uniform(12.0, 40.0), turn=draw.choice((45.0, -45.0, 90.0)))
    return Case(Expected((says(words=BY_KEYS),), (says(LOST, UNSURE),)), hand=hand)


THIRD: dict[str, Fault] = {
    "program: answers one behind": Fault(one_behind),
    "program: drives twice": Fault(drives_twice),
    "program: gyro in a byte": Fault(gyro_in_a_byte),
    "program: map lacks a wall": Fault(wall_missing),
    "program: few particles": Fault(few_particles, (STEP7, STEP6)),
    "program: old after turns": Fault(old_after_turns),
    "program: grips early": Fault(grips_early),
    "program: u1 and u3 averaged": Fault(averaged),
    "program: sleeps": Fault(sleeps),
    "program: whole numbers": Fault(whole_numbers),
    "program: decimal comma": Fault(decimal_comma, LOCALIZING),
    "program: corners for centres": Fault(cell_corners, (STEP7, STEP6, PLAIN)),
    "wire: loose after turns": Fault(loose_after_turns),
    "wire: o4 slips backwards": Fault(slips_backwards),
    "wire: battery fades": Fault(battery),
    "set: u1 mounted low": Fault(mounted_low),
    "set: compass by a magnet": Fault(hard_iron, LOCALIZING),
    "set: ranges blind below 8": Fault(blind_nearby),
    "hand: drives by keys": Fault(drives_by_keys),
}
"""The kinds, by name."""
