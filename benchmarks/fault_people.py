"""Faults of programs, and people who put the robot or the block elsewhere.

A function draws one kind of fault for a run; `fault_kinds.py` has the common grounds and the table.
"""

from __future__ import annotations

import random

from fault_answers import (
    CRASHED,
    ENDED,
    LOST,
    MISSED,
    NOT_DONE,
    NOTHING,
    NOWHERE,
    SLOW,
    STUCK,
    UNSURE,
    Case,
    Expected,
    Hand,
    devices,
    says,
)

PERSON = ("person", "teleport", "by hand")


# -- people -----------------------------------------------------------------------------------


def hand_teleport(draw: random.Random) -> Case:
    """A person puts the robot into another cell: that is to be said, not that the program lost its way."""
    return Case(
        Expected((says(words=PERSON),), (says(LOST, UNSURE),)),
        hand=Hand("teleport", at=draw.uniform(12.0, 40.0)),
    )


def hand_turn(draw: random.Random) -> Case:
    """A person turns the robot on the spot."""
    turn = draw.choice((60.0, -60.0, 120.0, -120.0, 180.0))
    return Case(
        Expected((says(words=PERSON),), (says(LOST, UNSURE),)),
        hand=Hand("turn", at=draw.uniform(12.0, 40.0), turn=turn),
    )


def hand_block(draw: random.Random) -> Case:
    """A person takes the block away from before the robot, to where nobody looks for it. That the gripper
    closed on nothing is true, but half."""
    return Case(
        Expected((says(words=PERSON),), (says(MISSED),)),
        hand=Hand("block", near=6.5),
    )


# -- the program ------------------------------------------------------------------------------


def crash(*words: str, printed: str = "line ") -> Expected:
    """A crash counts with its exception, and with its line among what was printed; else in part."""
    return Expected(right=(says(CRASHED, words=words, printed=printed),), partly=(says(CRASHED),))


def program_key_error(draw: random.Random) -> Case:
    """An exception in mid-run."""
    return Case(crash("KeyError"), program={"crash": "KeyError", "after": draw.randrange(60, 160)})


def program_zero_division(draw: random.Random) -> Case:
    """An exception right at the beginning, after the first readings."""
    return Case(crash("ZeroDivisionError"), program={"crash": "ZeroDivisionError", "after": 3})


def program_segfault(draw: random.Random) -> Case:
    """A signal ends it, as in an extension written in C: the signal is to be named."""
    signal = {"signal": 11, "after": draw.randrange(60, 160)}
    return Case(crash("signal 11", "SIGSEGV", "segmentation", printed=""), program=signal)


def program_exit(draw: random.Random) -> Case:
    """It ends with exit code 3, without a word: that, and the code."""
    ended = says(ENDED, CRASHED, words=("exit code 3",))
    partly = says(ENDED, CRASHED)
    return Case(Expected((ended,), (partly,)), program={"exit": 3, "after": draw.randrange(60, 160)})


def program_missing(draw: random.Random) -> Case:
    """There is no such file: it is to be named."""
    right = says(CRASHED, NOTHING, ENDED, words=("nosuch.py",))
    return Case(Expected((right,), (says(CRASHED, NOTHING),)), script="nosuch.py")


def program_missing_module(draw: random.Random) -> Case:
    """A module that it imports is not there."""
    right = says(CRASHED, NOTHING, words=("ModuleNotFoundError", "no module named"))
    return Case(
        Expected((right,), (says(CRASHED, NOTHING),)),
        script="-c 'import localization_of_mine'",
    )


def program_other_port(draw: random.Random) -> Case:
    """It looks for the simulator on another port."""
    words = ("RobotUnreachableError", "no simulator answers")
    return Case(
        Expected((says(CRASHED, NOTHING, words=words),), (says(CRASHED, NOTHING, ENDED),)),
        # The discard port, on which nobody listens; both protocols.
        environment={"SIMMER_PORT": "9", "SIMMER_PACKET_PORT": "9", "SIMMER_PACKET_REPLY_PORT": "9"},
    )


def going_nowhere(draw: random.Random, loop: str) -> Case:
    """However it ends, by time or by the drift that took it to a wall, it got nowhere. `stuck` meant that and
    more before there was a kind for it."""
    partly = (says(STUCK), says(SLOW))
    program = {"loop": loop, "after": draw.randrange(80, 200)}
    return Case(Expected((says(NOWHERE),), partly), program=program)


def program_turning(draw: random.Random) -> Case:
    """It turns on the spot for ever."""
    return going_nowhere(draw, "turn")


def program_to_and_fro(draw: random.Random) -> Case:
    """It goes to and fro for ever."""
    return going_nowhere(draw, "to and fro")


def program_reading(draw: random.Random) -> Case:
    """It reads one sensor for ever: no movement at all, until the time is over."""
    program = {"loop": "read", "after": draw.randrange(80, 200)}
    return Case(Expected((says(NOWHERE, SLOW),), (says(STUCK),)), program=program)


def program_never_opens(draw: random.Random) -> Case:
    """It carries the block to the drop zone and never lets go: it ended with the block in the gripper.

    Admitted is that the gripper was never opened, which is the same: the log cannot know who left it out."""
    words = ("held the block", "holds the block", "still held", "let go", "never opened")
    right, admitted = says(ENDED, words=words), says(NOT_DONE, culprits=devices("p1"))
    return Case(Expected((right,), (says(ENDED),), (admitted,)), program={"skip": "p1-0"})


# -- those that do not make a run fail, but must be reported ---------------------------------------


def after_success(draw: random.Random) -> Case:
    """A crash after the block was delivered: a success, with a note."""
    return Case(Expected(), program={"crash_at_end": "KeyError"}, outcomes=frozenset(("succeeded",)))


def belief_turned(draw: random.Random) -> Case:
    """Headings of beliefs are half a turn off; the program itself knows better."""
    rule = {"on": "belief", "do": "turn", "value": 180.0}
    return Case(Expected(), rules=(rule,), outcomes=frozenset(("succeeded",)))


def belief_frozen(draw: random.Random) -> Case:
    """From some belief on the same one is sent again and again; the program itself knows better."""
    rule = {"on": "belief", "do": "freeze", "from": draw.randrange(30, 45)}
    return Case(Expected(), rules=(rule,), outcomes=frozenset(("succeeded",)))
