"""A second table of faults, by somebody who had not read how reports find their causes.

    python benchmarks/faults.py --table independent

All expected answers here were written before the first run, and none was added later. The common grounds are
those of `fault_kinds.py`. A program that misunderstands its own sensors, drives or units leaves the same log
as a change on the wire, so the same answers count for it.
"""

from __future__ import annotations

import math
import random

from fault_answers import (
    APART,
    CLEARANCE,
    CRASHED,
    DELIVERING,
    DRIVE,
    DRIVE_ERROR,
    ENDED,
    HELD_BLOCK,
    LOST,
    MISSED,
    NOT_DONE,
    NOTHING,
    NOWHERE,
    OUTSIDE,
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
from fault_devices import NOBODY, drive_cell, in_set, on_wire, sensor_cell, swallowed
from fault_people import PERSON, crash, going_nowhere

_MOVED = says(words=PERSON)
"""Somebody moved the robot or the block by hand."""

_OF_THE_COURSE = (STEP7, STEP6)
"""Programs that get their robot's set from the simulator, and can be given a wrong one."""


# -- the program ------------------------------------------------------------------------------


def gives_up(draw: random.Random) -> Case:
    """It ends with a message on stderr and exit code 1, at a moment that has no reason in the run. That it
    had not found out where it was is true where it is said without a culprit, but not why."""
    words = ("exit code 1", "the block is not where it was")
    partly = (says(ENDED, CRASHED), says(UNSURE, culprits=NOBODY))
    program = {"crash": "SystemExit", "after": draw.randrange(60, 160)}
    return Case(Expected((says(ENDED, CRASHED, words=words),), partly), program=program)


def killed(draw: random.Random) -> Case:
    """It is killed by signal 9, as by a system without memory."""
    words = ("signal 9", "SIGKILL", "killed")
    return Case(crash(*words, printed=""), program={"signal": 9, "after": draw.randrange(60, 160)})


def crash_with_block(draw: random.Random) -> Case:
    """An exception while it carries the block."""
    program = {"crash": "AssertionError", "when": "p1-1", "after": draw.randrange(12, 30)}
    return Case(crash("AssertionError"), program=program)


def syntax_error(draw: random.Random) -> Case:
    """Python cannot read it: the error is to be named."""
    right = says(CRASHED, NOTHING, words=("SyntaxError",))
    return Case(Expected((right,), (says(CRASHED, NOTHING),)), script="-c 'def go(:'")


def thinks_it_is_done(draw: random.Random) -> Case:
    """It ends in the middle with exit code 0 and without a word."""
    partly = (says(UNSURE, culprits=NOBODY),)
    program = {"exit": 0, "after": draw.randrange(60, 160)}
    return Case(Expected((says(ENDED),), partly), program=program)


def lets_go_on_the_way(draw: random.Random) -> Case:
    """It opens the gripper once on the way and continues: the block lies outside the drop zone."""
    partly = (says(ENDED, NOWHERE), says(MISSED))
    program = {"send": ["p1-0"], "when": "p1-1", "after": draw.randrange(14, 30)}
    return Case(Expected((says(OUTSIDE, culprits=NOBODY),), partly), program=program)


def never_grips(draw: random.Random) -> Case:
    """It leaves out the command that closes the gripper. That it ended, or went over time, before it took the
    block is true, but half."""
    right = (says(NOT_DONE, culprits=NOBODY), says(NOT_DONE, culprits=devices("p1")))
    right += (says(APART, culprits=devices("p1")),)
    words = ("gripper", "took the block", "taken", "never closed")
    partly = (says(NOT_DONE), says(ENDED, SLOW, NOWHERE, words=words))
    return Case(Expected(right, partly), program={"skip": "p1-1"})


def spins_with_block(draw: random.Random) -> Case:
    """It turns on the spot with the block in the gripper, which sticks out. That no sensor was read meanwhile
    is true, and beside the point."""
    program = {"send": ["r1-90"] * 4, "when": "p1-1", "after": draw.randrange(12, 25)}
    return Case(Expected((says(HELD_BLOCK, CLEARANCE, culprits=NOBODY),), (says(UNREAD),)), program=program)


def drives_blindly(draw: random.Random) -> Case:
    """It drives 40 in ahead at once, without a look: a wall that it had seen is nearer."""
    right = (says(UNREAD, CLEARANCE, culprits=NOBODY), says(APART, culprits=NOBODY))
    partly = (says(UNREAD, CLEARANCE, APART), says(STUCK, LOST, UNSURE, HELD_BLOCK, culprits=NOBODY))
    program = {"send": ["d1-40"], "after": draw.randrange(60, 160)}
    return Case(Expected(right, partly), program=program)


def square(draw: random.Random) -> Case:
    """It goes round a small square for ever."""
    return going_nowhere(draw, "square")


def asks_in_vain(draw: random.Random) -> Case:
    """It sends a drive that the robot has not, for ever, and each is refused: nothing moves any more."""
    right = (says(NOWHERE, SLOW), says(NOT_DONE), says(words=("refused",)))
    program = {"loop": "refused", "after": draw.randrange(80, 200)}
    return Case(Expected(right, (says(STUCK),)), program=program)


def centimetres(draw: random.Random) -> Case:
    """It takes inches for centimetres: what it reads is 2.54 times as long."""
    return Case(on_wire(RANGES), rules=({"on": "reply", "codes": RANGES, "do": "scale", "value": 2.54},))


def radians(draw: random.Random) -> Case:
    """It sends turns in radians: the robot turns by a 57th of what is meant, for ever correcting."""
    rule = {"on": "command", "codes": ["r1"], "do": "scale", "value": math.pi / 180.0}
    return Case(on_wire(("r1",)), rules=(rule,))


def left_is_right(draw: random.Random) -> Case:
    """It has the wrong sign in movements to the side."""
    return Case(on_wire(("w1",)), rules=({"on": "command", "codes": ["w1"], "do": "scale", "value": -1.0},))


def wrong_map(draw: random.Random) -> Case:
    """Its map has left and right exchanged: it reads rightly, moves rightly, and is wrong about where it is.
    No sensor and no drive is at fault."""
    right = (says(LOST, UNSURE, culprits=NOBODY), says(APART, culprits=NOBODY))
    partly = (says(APART), says(NOWHERE, MISSED, CLEARANCE, UNREAD, ENDED, STUCK, culprits=NOBODY))
    return Case(Expected(right, partly), mirrored=True)


def mounted_otherwise(draw: random.Random) -> Case:
    """It believes that u2 and u4 look to the sides; they look 45 degrees ahead of that."""
    cells = (sensor_cell("u2", "Rotation (deg)", 90), sensor_cell("u4", "Rotation (deg)", 270))
    return Case(on_wire(("u2", "u4")), known=cells)


def wrong_drop_zone(draw: random.Random) -> Case:
    """It sets the block down in a cell that is no drop zone."""
    return Case(
        Expected((says(OUTSIDE, culprits=NOBODY),), (says(ENDED),)),
        environment={"SIMMER_DROP_ZONE": "30,6"},
    )


# -- on the wire ------------------------------------------------------------------------------


def _reply(codes: tuple[str, ...], do: str, *more: Answer, **rule: object) -> Case:
    return Case(on_wire(codes, *more), rules=({"on": "reply", "codes": codes, "do": do, **rule},))


def _command(code: str, do: str, value: float) -> Case:
    return Case(on_wire((code,)), rules=({"on": "command", "codes": (code,), "do": do, "value": value},))


def wire_gyro_inverted(draw: random.Random) -> Case:
    """The program gets the gyro's angles with the other sign."""
    return _reply(("g1",), "scale", value=-1.0)


def wire_gyro_drift(draw: random.Random) -> Case:
    """The gyro's angles grow by half a degree with each reading."""
    return _reply(("g1",), "drift", value=draw.choice((-0.5, 0.5)))


def wire_odometers_doubled(draw: random.Random) -> Case:
    """The wheels that roll ahead count twice for the program."""
    return _reply(("o3", "o4"), "scale", value=2.0)


def wire_odometers_swapped(draw: random.Random) -> Case:
    """The program's o1 is the robot's o3 and the other way round: ahead and aside are mixed."""
    return Case(on_wire(("o1", "o3")), rules=({"on": "command", "codes": ("o1", "o3"), "do": "swap"},))


def wire_coarse(draw: random.Random) -> Case:
    """Ranges come in steps of 8 in."""
    return _reply(RANGES, "round", value=8.0)


def wire_ranges_frozen(draw: random.Random) -> Case:
    """From some command on all ranges say for ever what they said first. That none was read is wrong in the
    log, that nothing new came is the point."""
    return _reply(RANGES, "late", value=10**6, **{"from": draw.randrange(80, 200)})


def wire_drives_swapped(draw: random.Random) -> Case:
    """Ahead goes to the side, and aside goes ahead."""
    return Case(on_wire(("d1", "w1")), rules=({"on": "command", "codes": ("d1", "w1"), "do": "swap"},))


def wire_turns_doubled(draw: random.Random) -> Case:
    """The robot turns twice as far as the program said."""
    return _command("r1", "scale", 2.0)


def wire_every_third_lost(draw: random.Random) -> Case:
    """About one movement ahead in three never reaches the robot."""
    partly = says(NOWHERE, LOST, UNSURE, MISSED, CLEARANCE, culprits=NOBODY)
    return swallowed("d1", partly, every=3)


def wire_load_stuck(draw: random.Random) -> Case:
    """The load sensor says 0 for ever: the program takes the block, and does not know."""
    more = (says(OUTSIDE, ENDED, culprits=NOBODY),)
    return _reply(("l1",), "constant", *more, value=0.0)


# -- in the set -------------------------------------------------------------------------------


def set_ranges_gain(draw: random.Random) -> Case:
    """All range sensors say 1.3 times the distance."""
    return Case(in_set(*RANGES), cells=tuple(sensor_cell(code, "Gain", 1.3) for code in RANGES))


def set_dropout(draw: random.Random) -> Case:
    """Two range sensors miss nine readings in ten: either is right, and both."""
    codes = draw.choice((("u1", "u3"), ("u2", "u4"), ("u1", "u2")))
    return Case(in_set(*codes), cells=tuple(sensor_cell(code, "Dropout", 0.9) for code in codes))


def set_gyro_inverted(draw: random.Random) -> Case:
    """The gyro counts the other way."""
    return Case(in_set("g1"), cells=(sensor_cell("g1", "Gain", -1),))


def set_gyro_drift(draw: random.Random) -> Case:
    """The gyro drifts by 1.5 degrees a second of simulated time."""
    return Case(in_set("g1"), cells=(sensor_cell("g1", "Drift (per s)", 1.5),))


def set_range_drift(draw: random.Random) -> Case:
    """A range sensor drifts: 6 in too long after a minute."""
    code = draw.choice(("u1", "u2", "u3", "u4"))
    return Case(in_set(code), cells=(sensor_cell(code, "Drift (per s)", 0.1),))


def set_short_sighted(draw: random.Random) -> Case:
    """All range sensors see 6 in far."""
    return Case(in_set(*RANGES), cells=tuple(sensor_cell(code, "Max Range (in)", 6) for code in RANGES))


def _drive_in_set(*codes: str, cells: tuple[tuple[str, str, str, str], ...]) -> Case:
    """That a drive's error is the cause is right without its name, too: there is one movement that it
    is said of."""
    named = says(DRIVE_ERROR, DRIVE, culprits=NOBODY)
    return Case(in_set(*codes, more=(named,)), cells=cells)


def set_turn_long(draw: random.Random) -> Case:
    """Turns go 1.6 times as far as commanded."""
    return _drive_in_set("r1", cells=(drive_cell("r1", "Gain", 1.6),))


def set_side_inverted(draw: random.Random) -> Case:
    """Movements to the side go to the other one."""
    return _drive_in_set("w1", cells=(drive_cell("w1", "Gain", -1),))


def set_drives_swapped(draw: random.Random) -> Case:
    """The codes of the drives ahead and aside are swapped: either is right, and both."""
    cells = (drive_cell("d1", "Poll Character", "w1"), drive_cell("w1", "Poll Character", "d1"))
    return _drive_in_set("d1", "w1", cells=cells)


def set_drive_noisy(draw: random.Random) -> Case:
    """Driving ahead errs by half of the way, ten times what is usual."""
    return _drive_in_set("d1", cells=(drive_cell("d1", "X-Axis Error", 0.5),))


# -- people -----------------------------------------------------------------------------------


def hand_nudged(draw: random.Random) -> Case:
    """A person pushes the robot by 3 in, which a belief hardly shows."""
    hand = Hand("teleport", at=draw.uniform(12.0, 40.0), shift=3.0)
    return Case(Expected((_MOVED,), (says(LOST, UNSURE),)), hand=hand)


def hand_reset(draw: random.Random) -> Case:
    """A person puts everything back to the beginning, and the program continues."""
    hand = Hand("reset", at=draw.uniform(12.0, 30.0))
    words = (*PERSON, "reset")
    return Case(Expected((says(words=words),), (says(LOST, UNSURE),)), hand=hand)


def hand_block_gone(draw: random.Random) -> Case:
    """A person takes the block out of the loading zone at the very beginning: it is never found. That it was
    not found, or time went by with searching, is true, but half."""
    partly = (says(MISSED), says(ENDED, NOWHERE, SLOW, culprits=NOBODY))
    return Case(Expected((_MOVED,), partly), hand=Hand("block", at=1.0))


def hand_turned_with_block(draw: random.Random) -> Case:
    """A person turns the robot while it carries the block."""
    hand = Hand("turn", holding=True, turn=draw.choice((90.0, -90.0, 180.0)))
    return Case(Expected((_MOVED,), (says(LOST, UNSURE),)), hand=hand)


def hand_block_nudged(draw: random.Random) -> Case:
    """A person pushes the block by 3 in while the robot comes near."""
    return Case(Expected((_MOVED,), (says(MISSED),)), hand=Hand("block", near=6.5, shift=3.0))


def hand_paused(draw: random.Random) -> Case:
    """A person pauses and continues, which changes nothing; the program crashes later, and that is why."""
    program = {"crash": "KeyError", "after": draw.randrange(100, 160)}
    return Case(crash("KeyError"), program=program, hand=Hand("pause", at=draw.uniform(0.2, 1.0)))


INDEPENDENT: dict[str, Fault] = {
    "program: gives up": Fault(gives_up),
    "program: SIGKILL": Fault(killed),
    "program: crash with the block": Fault(crash_with_block, DELIVERING),
    "program: SyntaxError": Fault(syntax_error),
    "program: exit code 0 in between": Fault(thinks_it_is_done),
    "program: lets go on the way": Fault(lets_go_on_the_way, DELIVERING),
    "program: never grips": Fault(never_grips),
    "program: spins with the block": Fault(spins_with_block, DELIVERING),
    "program: drives blindly": Fault(drives_blindly),
    "program: square for ever": Fault(square),
    "program: refused for ever": Fault(asks_in_vain),
    "program: takes in for cm": Fault(centimetres),
    "program: turns in radians": Fault(radians),
    "program: left is right": Fault(left_is_right),
    "program: map mirrored": Fault(wrong_map, _OF_THE_COURSE),
    "program: u2, u4 otherwise": Fault(mounted_otherwise, _OF_THE_COURSE),
    "program: other drop zone": Fault(wrong_drop_zone, DELIVERING),
    "wire: gyro inverted": Fault(wire_gyro_inverted),
    "wire: gyro drifts": Fault(wire_gyro_drift),
    "wire: odometers doubled": Fault(wire_odometers_doubled),
    "wire: o1 and o3 swapped": Fault(wire_odometers_swapped),
    "wire: ranges in steps of 8": Fault(wire_coarse),
    "wire: ranges frozen": Fault(wire_ranges_frozen),
    "wire: d1 and w1 swapped": Fault(wire_drives_swapped),
    "wire: turns doubled": Fault(wire_turns_doubled),
    "wire: every third drive lost": Fault(wire_every_third_lost),
    "wire: load stuck at 0": Fault(wire_load_stuck),
    "set: ranges gain 1.3": Fault(set_ranges_gain),
    "set: two ranges drop out": Fault(set_dropout),
    "set: gyro inverted": Fault(set_gyro_inverted),
    "set: gyro drifts": Fault(set_gyro_drift),
    "set: a range drifts": Fault(set_range_drift),
    "set: ranges see 6 in": Fault(set_short_sighted),
    "set: turn gain 1.6": Fault(set_turn_long),
    "set: w1 inverted": Fault(set_side_inverted),
    "set: d1 and w1 swapped": Fault(set_drives_swapped),
    "set: drive noisy": Fault(set_drive_noisy),
    "hand: robot nudged": Fault(hand_nudged),
    "hand: reset": Fault(hand_reset),
    "hand: block gone at once": Fault(hand_block_gone),
    "hand: turned with the block": Fault(hand_turned_with_block),
    "hand: block nudged": Fault(hand_block_nudged),
    "hand: paused, then KeyError": Fault(hand_paused),
}
"""The kinds, by name."""
