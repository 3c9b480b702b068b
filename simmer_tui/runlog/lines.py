"""The lines of a run log, made by hand: json.dumps takes several times as long.

Every line begins with `t`, `kind` and, for a command, `status`, in this order and without spaces:
the index finds its way through a log by these beginnings.
"""

from __future__ import annotations

import json
from json.encoder import encode_basestring_ascii as quoted

import numpy as np

from simmer_tui.engine import ActionDone, Belief, Notice, TwinReading
from simmer_tui.runlog.numbers import list_text, nested_text, number_text
from simmer_tui.sim.records import Grip, Outcome, Pose, RangeScan, Reading
from simmer_tui.sim.trajectory import Trajectory

PATH_POINTS = 41
"""Most points of a path in a line; of longer ones every second, fourth... point is written."""
_TRUTH = {False: "false", True: "true"}


def command_line(outcome: Outcome, wall: float) -> str:
    """The line of one command."""
    command = outcome.command
    before = pose_text(outcome.before)
    pose = before if outcome.pose is outcome.before else pose_text(outcome.pose)
    text = (
        f'{{"t":{number_text(outcome.time)},"kind":"command","verdict":"{outcome.status}",'
        f'"number":{outcome.number},"wall":{wall!r},"source":{quoted(command.source)},'
        f'"command":{quoted(command.text)},"reply":{number_text(outcome.reply)},'
        f'"before":{before},"pose":{pose}'
    )
    if outcome.reading is not None:
        return f"{text}{_reading_fields(outcome.reading)}}}"
    if outcome.trajectory is not None:
        grip = "" if outcome.grip is None else _grip_fields(outcome.grip)
        return f"{text}{grip}{_movement_fields(outcome.trajectory)}}}"
    return f'{text},"reason":{quoted(outcome.reason)}}}'


def _reading_fields(reading: Reading) -> str:
    text = f',"sensor":"{reading.sensor.id}","true":{number_text(reading.true)}'
    view = reading.view
    if view is None:
        return text
    if isinstance(view, RangeScan):
        return (
            f'{text},"rays":{{"origin":{list_text(view.origin)},'
            f'"bearings":{list_text(view.bearings)},"distances":{list_text(view.distances)}}}'
        )
    black = (view.black.astype(np.uint8) + ord("0")).tobytes().decode()
    return (
        f'{text},"points":{{"centre":{list_text(view.centre)},'
        f'"radius":{number_text(view.radius)},"black":"{black}"}}'
    )


def _grip_fields(grip: Grip) -> str:
    return (
        f',"grip":{{"closed":{_TRUTH[grip.closed]},"holding":{_TRUTH[grip.holding]},'
        f'"block":{pose_text(grip.block)}}}'
    )


def _movement_fields(trajectory: Trajectory) -> str:
    end = trajectory.end_time
    path = trajectory.trail(end).tolist()
    stride = 1
    while len(path) > PATH_POINTS * stride:
        stride *= 2
    if stride > 1:
        path = [*path[:-1:stride], path[-1]]
    text = (
        f',"begin":{number_text(trajectory.start_time)},"end":{number_text(end)},'
        f'"cut":{_TRUTH[trajectory.cut is not None]},"path":{nested_text(path)}'
    )
    contact = trajectory.contact
    if contact is None:
        return text
    text += f',"contact":{list_text(contact.point)},"contact_time":{number_text(contact.time)}'
    return f'{text},"held":{"null" if trajectory.held_at is None else number_text(trajectory.held_at)}'


def action_line(done: ActionDone, number: int, wall: float) -> str:
    """The line of a person's action; `number` commands had been begun when it was done."""
    action = done.action
    return (
        f'{{"t":{number_text(done.time)},"kind":"action","action":"{action.name}",'
        f'"number":{number},"wall":{wall!r},"source":{quoted(action.source)},'
        f'"arguments":{list_text(action.arguments)},"refused":{_TRUTH[done.refused]},'
        f'"text":{quoted(done.text)},"pose":{pose_text(done.pose)}}}'
    )


def belief_line(belief: Belief, wall: float) -> str:
    """The line of a believed pose."""
    spread = "null" if belief.spread is None else number_text(belief.spread)
    particles = nested_text([[float(value) for value in each] for each in belief.particles])
    return (
        f'{{"t":{number_text(belief.time)},"kind":"belief","wall":{wall!r},'
        f'"believed":{pose_text(belief.pose)},"pose":{pose_text(belief.true)},'
        f'"spread":{spread},"note":{quoted(belief.note)},"particles":{particles}}}'
    )


def notice_line(notice: Notice, time: float, wall: float) -> str:
    """The line of a notice; it has no time of its own."""
    return (
        f'{{"t":{number_text(time)},"kind":"notice","wall":{wall!r},'
        f'"about":"{notice.kind}","subject":{quoted(notice.subject)},"text":{quoted(notice.text)}}}'
    )


def twin_line(twin: TwinReading, wall: float) -> str:
    """The line of a sensor read on the real robot and on its simulated twin."""
    return (
        f'{{"t":{number_text(twin.time)},"kind":"twin","wall":{wall!r},'
        f'"source":{quoted(twin.command.source)},"command":{quoted(twin.command.text)},'
        f'"code":{quoted(twin.code)},"robot":{number_text(twin.robot)},'
        f'"simulated":{number_text(twin.simulated)}}}'
    )


def pose_text(pose: Pose) -> str:
    """[x, y, heading]."""
    return list_text((pose.x, pose.y, pose.heading))


def header_text(fields: dict[str, object]) -> str:
    """The first line. It is written once, so its making may take its time."""
    return json.dumps(fields, separators=(",", ":"), allow_nan=False)
