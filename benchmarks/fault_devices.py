"""Faults of sensors and drives: on the wire, where the log does not show them, and in the set, where it does.

A function draws one kind of fault for a run; `fault_kinds.py` has the common grounds and the table.
"""

from __future__ import annotations

import random
from typing import Any

from fault_answers import (
    APART,
    CLEARANCE,
    CRASHED,
    DRIVE,
    DRIVE_ERROR,
    ENDED,
    EXPLAINED,
    LOST,
    MISSED,
    NOT_DONE,
    NOWHERE,
    RANGES,
    SENSOR,
    SLOW,
    UNREAD,
    UNSURE,
    Answer,
    Case,
    Expected,
    devices,
    says,
)

NOBODY: frozenset[str] = frozenset()


# -- on the wire ------------------------------------------------------------------------------


def on_wire(codes: tuple[str, ...], *more: Answer) -> Expected:
    """Right answers for sensors or drives whose words are changed on the wire."""
    guilty = devices(*codes)
    return Expected(
        right=(
            says(APART, culprits=NOBODY),
            says(APART, culprits=guilty, others=True),
            says(*EXPLAINED, NOT_DONE, culprits=guilty),
        ),
        partly=(
            says(*EXPLAINED, NOT_DONE, culprits=guilty, others=True),
            # A report that says it cannot decide is right; one that names a culprit is not.
            says(APART),
            # True of the log, if without its reason.
            says(LOST, UNSURE, NOWHERE, MISSED, CLEARANCE, culprits=NOBODY),
            *more,
        ),
    )


def wire_range_long(draw: random.Random) -> Case:
    """One range is 3 in too long for the program alone: no reading of the log is wrong."""
    code = draw.choice(("u1", "u2", "u3", "u4", "u5"))
    rule = {"on": "reply", "codes": [code], "do": "add", "value": 3.0}
    return Case(on_wire((code,)), rules=(rule,))


def wire_ranges_long(draw: random.Random) -> Case:
    """All ranges are 3 in too long for the program alone."""
    return Case(on_wire(RANGES), rules=({"on": "reply", "codes": RANGES, "do": "add", "value": 3.0},))


def wire_gyro_short(draw: random.Random) -> Case:
    """The program gets 0.8 of each angle of the gyro; its heading is off by what it turned."""
    return Case(on_wire(("g1",)), rules=({"on": "reply", "codes": ["g1"], "do": "scale", "value": 0.8},))


def wire_swapped(draw: random.Random) -> Case:
    """The program's u2 is the robot's u4 and the other way round."""
    return Case(on_wire(("u2", "u4")), rules=({"on": "command", "codes": ["u2", "u4"], "do": "swap"},))


def wire_late(draw: random.Random) -> Case:
    """Ranges come two readings late."""
    return Case(on_wire(RANGES), rules=({"on": "reply", "codes": RANGES, "do": "late", "value": 2},))


def wire_stuck(draw: random.Random) -> Case:
    """From some command on u1 says 20 in, whatever is there."""
    rule = {"on": "reply", "codes": ["u1"], "do": "constant", "value": 20.0, "from": draw.randrange(100, 300)}
    return Case(on_wire(("u1",), says(UNREAD)), rules=(rule,))


def wire_turn_inverted(draw: random.Random) -> Case:
    """Turns go the other way than the program says; the log has the command as it came."""
    return Case(on_wire(("r1",)), rules=({"on": "command", "codes": ["r1"], "do": "scale", "value": -1.0},))


def wire_drive_long(draw: random.Random) -> Case:
    """The robot drives 3 times as far as the program commanded."""
    return Case(on_wire(("d1",)), rules=({"on": "command", "codes": ["d1"], "do": "scale", "value": 3.0},))


def wire_compass(draw: random.Random) -> Case:
    """The compass is read half a turn off: the program believes to head the other way."""
    return Case(on_wire(("c1",)), rules=({"on": "reply", "codes": ["c1"], "do": "add", "value": 180.0},))


def swallowed(code: str, *more: Answer, **rule: Any) -> Case:
    """Case of a drive or gripper whose commands, or those that the rule picks, are not passed on."""
    return Case(
        Expected(
            (
                says(NOT_DONE, culprits=NOBODY),
                says(NOT_DONE, culprits=devices(code)),
                says(APART, culprits=NOBODY),
                says(APART, culprits=devices(code), others=True),
                says(*EXPLAINED, culprits=devices(code)),
            ),
            (says(NOT_DONE), *more),
        ),
        rules=({"on": "command", "codes": [code], "do": "swallow", **rule},),
    )


def wire_grip_swallowed(draw: random.Random) -> Case:
    """The gripper never gets the command to close: not that the program ended too early, nor that it gripped
    beside the block."""
    return swallowed("p1", value=1.0)


def wire_open_swallowed(draw: random.Random) -> Case:
    """The gripper never gets the command to open. That the program ended with the block in it is true, but
    half."""
    return swallowed("p1", says(ENDED, words=("held the block", "holds the block")), value=0.0)


def wire_drive_swallowed(draw: random.Random) -> Case:
    """From some command on the robot gets no more commands to drive: it stands still, its turns apart."""
    partly = says(NOWHERE, LOST, UNSURE, culprits=NOBODY)
    return swallowed("d1", partly, **{"from": draw.randrange(100, 300)})


def wire_cut(draw: random.Random) -> Case:
    """The connection ends in mid-run. The programs of the course do not expect it: an exception, as for any
    crash; solve.py says it and ends with exit code 1."""
    words = ("RobotClosedError", "closed the connection", "RobotTimeoutError")
    return Case(
        Expected((says(CRASHED, ENDED, words=words),), (says(CRASHED, ENDED),)),
        rules=({"on": "command", "do": "cut", "from": draw.randrange(100, 300)},),
    )


# -- in the set -------------------------------------------------------------------------------


def in_set(*codes: str, more: tuple[Answer, ...] = ()) -> Expected:
    """Right answers for sensors and drives that differ from those of the bundled set."""
    guilty = devices(*codes)
    return Expected(
        right=(says(*EXPLAINED, culprits=guilty), *more),
        partly=(
            says(*EXPLAINED, APART, culprits=guilty, others=True),
            says(culprits=NOBODY, findings=guilty),
            says(LOST, UNSURE, culprits=NOBODY),
        ),
    )


def sensor_cell(code: str, column: str, value: object) -> tuple[str, str, str, str]:
    """A cell of sensors.csv with another value."""
    return ("sensors.csv", code, column, str(value))


def drive_cell(code: str, column: str, value: object) -> tuple[str, str, str, str]:
    """A cell of drive.csv with another value."""
    return ("drive.csv", code, column, str(value))


def set_range_long(draw: random.Random) -> Case:
    """One range sensor reads 3 in too long: it is to be named, with beliefs and without."""
    code = draw.choice(("u1", "u2", "u3", "u4", "u5"))
    return Case(in_set(code), cells=(sensor_cell(code, "Bias", 3),))


def set_ranges_long(draw: random.Random) -> Case:
    """All range sensors read 3 in too long: any of them is right."""
    return Case(in_set(*RANGES), cells=tuple(sensor_cell(code, "Bias", 3) for code in RANGES))


def set_gyro_short(draw: random.Random) -> Case:
    """The gyro counts 0.8 of each angle."""
    return Case(in_set("g1"), cells=(sensor_cell("g1", "Gain", 0.8),))


def set_stuck(draw: random.Random) -> Case:
    """A range sensor says 9 in for ever."""
    code = draw.choice(("u1", "u2", "u3", "u4"))
    return Case(in_set(code), cells=(sensor_cell(code, "Gain", 0), sensor_cell(code, "Bias", 9)))


def set_swapped(draw: random.Random) -> Case:
    """The codes of two sensors are swapped: either is right, and both."""
    cells = (sensor_cell("u2", "Poll Character", "u4"), sensor_cell("u4", "Poll Character", "u2"))
    return Case(in_set("u2", "u4"), cells=cells)


def set_compass(draw: random.Random) -> Case:
    """The compass reads 90 degrees too much."""
    return Case(in_set("c1"), cells=(sensor_cell("c1", "Bias", 90),))


def set_odometers(draw: random.Random) -> Case:
    """The wheels that roll ahead count 0.6 of the way."""
    return Case(in_set("o3", "o4"), cells=tuple(sensor_cell(code, "Gain", 0.6) for code in ("o3", "o4")))


def set_mounted_askew(draw: random.Random) -> Case:
    """A range sensor looks 25 degrees beside where it is to: no offset and no gain says so, but that it is
    wrong can be seen."""
    code = draw.choice(("u1", "u2", "u3", "u4"))
    angle = {"u1": 25, "u2": 70, "u3": 205, "u4": 340}[code]
    return Case(in_set(code), cells=(sensor_cell(code, "Rotation (deg)", angle),))


def set_noisy(draw: random.Random) -> Case:
    """A range sensor errs by half of what it says, 25 times what is usual."""
    code = draw.choice(("u1", "u2", "u4", "u5"))
    return Case(in_set(code), cells=(sensor_cell(code, "Percent Error (0-1)", 0.5),))


def set_load_inverted(draw: random.Random) -> Case:
    """The load sensor says the opposite: the program takes a block that it has for missed, and the other way
    round. That it missed the block is wrong where it did not."""
    return Case(in_set("l1"), cells=(sensor_cell("l1", "Percent Error (0-1)", 1),))


def set_wheel_bias(draw: random.Random) -> Case:
    """Driving ahead turns the robot by 3 degrees an inch: a drive error that another robot would not have
    made, whoever is named."""
    side = draw.choice((-3, 3))
    named = says(DRIVE_ERROR, DRIVE, culprits=NOBODY)
    cells = (drive_cell("d1", "Rotation Bias", side),)
    return Case(in_set("d1", more=(named,)), cells=cells, settings={"randbias": False})


def set_drive_long(draw: random.Random) -> Case:
    """Driving ahead goes 3 times as far as commanded."""
    named = says(DRIVE_ERROR, DRIVE, culprits=NOBODY)
    return Case(in_set("d1", more=(named,)), cells=(drive_cell("d1", "Gain", 3),))


def set_turn_inverted(draw: random.Random) -> Case:
    """Turns go the other way."""
    return Case(in_set("r1"), cells=(drive_cell("r1", "Gain", -1),))


def set_grip_short(draw: random.Random) -> Case:
    """The gripper reaches 0.4 in: it closes on nothing, which is what happened."""
    missed = says(MISSED)
    return Case(in_set("p1", more=(missed,)), cells=(drive_cell("p1", "Reach", 0.4),))


def set_slow_readings(draw: random.Random) -> Case:
    """A reading takes 3 s: the time is over before the mission is.

    Admitted is who names the sensors: that they answer late is why."""
    cells = tuple(sensor_cell(code, "Read Time (s)", 3) for code in RANGES)
    admitted = (says(SENSOR, culprits=frozenset(RANGES)),)
    return Case(Expected((says(SLOW),), admitted=admitted), cells=cells)
