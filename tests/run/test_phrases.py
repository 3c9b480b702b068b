"""Contacts, grips and endings in words, the same on every screen, page and line."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from msgspec import structs
from msgspec.structs import replace

from simmer_tui.cli.headless import EventLines
from simmer_tui.run.events import MovementEnded
from simmer_tui.run.phrases import (
    asked_text,
    contact_ending,
    contact_line,
    contact_text,
    contacts_text,
    grip_ending,
    grip_text,
    movement_text,
    obstacle_place,
    outside_text,
    scan_text,
    sent_by_text,
    side_text,
)
from simmer_tui.sim import DriveKind, Pose, SimulationSpec, Simulator
from simmer_tui.sim.angles import side_name
from simmer_tui.sim.command import Command
from simmer_tui.sim.records import Grip, LidarScan


def ended(spec: SimulationSpec, *commands: str) -> MovementEnded:
    """The end of the last of some movements."""
    simulator = Simulator(spec)
    for text in commands:
        result = simulator.execute(text)
    assert result.trajectory is not None
    return MovementEnded(1, result.time, result.command, result.trajectory, result.pose)


def test_a_contact_is_worded_alike_in_every_line(course_spec: SimulationSpec) -> None:
    movement = ended(course_spec, "d1-100")
    assert movement.contact is not None
    assert (
        EventLines().handle(movement) == f"contact: d1-100 {contact_ending(movement.contact, movement.pose)}"
    )
    said = contact_text(movement.contact, course_spec)
    assert said == f"the robot touched {obstacle_place(movement.contact, course_spec)}"


def test_what_a_contact_did_to_its_movement(course_spec: SimulationSpec) -> None:
    movement = ended(course_spec, "d1-100")
    contact = movement.contact
    assert contact is not None
    stopped = "was stopped after 35.5 in at (45.0, 42.0) heading 0.0 deg by the wall at (48.0, 42.0)"
    assert contact_ending(contact, movement.pose, "after 35.5 in ") == stopped
    later = contact_ending(contact, Pose(40.0, 42.0, 0.0))
    assert later == (
        "touched the wall at (48.0, 42.0) and was stopped later, at (40.0, 42.0) heading 0.0 deg"
    )
    went_on = contact_ending(replace_contact(contact, ended=False), movement.pose)
    assert went_on.startswith("touched the wall at (48.0, 42.0) and went on; it ended at (45.0, 42.0)")
    assert contact_line(movement, contact) == "contact ahead after 35.5 in"
    block = replace_contact(contact, cell=None, held_block=True)
    assert contact_line(movement, block) == "held block contact ahead after 35.5 in, the block"
    assert obstacle_place(block, course_spec) == "the block at (48.0, 42.0)"
    assert side_text(replace_contact(contact, point=(45.0, 40.0))) == "right"


@pytest.mark.parametrize("seed", range(8))
def test_the_distance_of_a_movement_is_that_of_the_totals(noisy_spec: SimulationSpec, seed: int) -> None:
    """In a curve the path is longer than what is left of it ahead; one run names one number."""
    result = Simulator(noisy_spec, seed=seed).execute("d1-30")
    assert result.trajectory is not None
    movement = MovementEnded(1, result.time, result.command, result.trajectory, result.pose)
    went = movement.trajectory.travelled(movement.time)
    assert movement_text(movement) == f"forward {went:.1f} in"


@pytest.mark.parametrize("kind", [kind for kind in DriveKind if not kind.turns])
def test_every_drive_has_a_direction_in_words(kind: DriveKind) -> None:
    """A drive that is added is worded by its direction, without an entry anywhere."""
    assert kind.meaning.split()[1] == asked_text(kind, 3.0).split()[-1]
    there, back = (asked_text(kind, value).split()[-1] for value in (3.0, -3.0))
    assert {there, back} in ({"forward", "back"}, {"left", "right"})


def test_sides_go_counter_clockwise_with_the_words_that_are_asked_for() -> None:
    names = [side_name(45.0 * eighth) for eighth in range(8)]
    assert names == [
        *("ahead", "ahead left", "left", "behind left", "behind", "behind right", "right", "ahead right")
    ]
    assert [side_name(bearing, "front", "rear") for bearing in (-45.0, 200.0)] == ["front right", "rear"]


def replace_contact(contact: Any, **changes: Any) -> Any:
    return structs.replace(contact, **changes)


@pytest.mark.parametrize(
    ("grip", "short", "ending"),
    [
        (Grip(0.0, False, False, Pose(0, 0, 0)), "open", "opened the gripper"),
        (
            Grip(0.0, True, True, Pose(0, 0, 0)),
            "holding the block",
            "closed the gripper, which holds the block",
        ),
        (
            Grip(0.0, True, False, Pose(0, 0, 0), (1.5, 0.0)),
            "closed on nothing",
            "closed the gripper, which holds nothing: the block's middle was 1.50 in too far ahead",
        ),
    ],
)
def test_a_grip_is_worded_once(grip: Grip, short: str, ending: str) -> None:
    assert (grip_text(grip), grip_ending(grip)) == (short, ending)
    assert grip_text(replace(grip, holding=True)) == "holding the block"


def test_small_phrases() -> None:
    assert [contacts_text(count) for count in (0, 1, 2)] == ["no contact", "1 contact", "2 contacts"]
    assert outside_text((-2.0, 1.0)) == "2.0 in to the left of and 1.0 in above"


@pytest.mark.parametrize(
    ("ranges", "text"),
    [
        ([7.0, 5.94, math.inf, 30.0], "4 ranges, nearest 5.9 in at -90 deg"),
        ([7.0, 35.0, 6.0, 0.0], "4 ranges, nearest 6.0 in at 180 deg"),
        ([5.0, 35.0, 6.0, 5.0], "4 ranges, nearest 5.0 in at 0 deg"),
        ([math.inf], "1 range, nothing in reach"),
        ([0.0, math.nan, math.inf], "3 ranges, nothing in reach"),
    ],
)
def test_a_scan_is_said_in_one_line(ranges: list[float], text: str) -> None:
    count = len(ranges)
    bearings = -360.0 * np.arange(count) / count
    assert scan_text(LidarScan(0, np.array(ranges), bearings, np.empty(0), np.empty((0, 3)))) == text


def test_boards_set_speeds_and_programs_send_commands() -> None:
    assert sent_by_text("console", "d1-3") == "d1-3 was sent"
    assert sent_by_text("boards", "ww-3;0") == "a board set ww-3;0"
    assert sent_by_text("boards, main at a.ino:4", "ww-3;0") == "board main at a.ino:4 set ww-3;0"


def test_speeds_that_a_board_makes_are_shown_with_two_decimals() -> None:
    text = "ww--5.30718954248;12"
    assert Command(text, "ww", source="boards, board rover at rover.ino:7").shown == "ww--5.31;12"
    assert Command(text, "ww").shown == text
