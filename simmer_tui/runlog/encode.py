"""The lines of a run log, made by hand: json.dumps takes several times as long.

Every line begins with `t` and `kind`, in this order and without spaces: the index finds its way
through a log by these beginnings. What follows from a line and those before it (rays, test points,
poses in between) is not written; `decode.py` works it out again.
"""

from __future__ import annotations

import json
from json.encoder import encode_basestring_ascii as quoted

from simmer_tui.events import (
    ActionDone,
    Belief,
    CommandResult,
    MissionEvent,
    MovementEnded,
    MovementPlanned,
    Notice,
    TwinReading,
)
from simmer_tui.run.state import Checkpoint
from simmer_tui.runlog.numbers import list_text, nested_text, number_text
from simmer_tui.sim.command import Command
from simmer_tui.sim.path import Contact
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import Grip, Status
from simmer_tui.sim.trajectory import Trajectory

_TRUTH = {False: "false", True: "true"}
USUAL_SOURCE = "client"
"""Who sent a command whose line does not say so."""


def reading_line(outcome: CommandResult, wall: float) -> str:
    """The line of a sensor that was read."""
    reading = outcome.reading
    assert reading is not None, "only a reading has a line of this kind"
    true = "" if reading.true == outcome.reply else f',"true":{number_text(reading.true)}'
    return (
        f"{_head(outcome.time, 'read', outcome.number, wall)}{_command_fields(outcome.command)},"
        f'"reply":{number_text(outcome.reply)}{true}{_moments(outcome)}}}'
    )


def answer_line(outcome: CommandResult, wall: float) -> str:
    """The line of any other answer."""
    reason = f',"reason":{quoted(outcome.reason)}' if outcome.reason else ""
    stops = ',"stops":true' if outcome.command.stops else ""
    return (
        f'{{"t":{number_text(outcome.time)},"kind":"answer","status":"{outcome.status}",'
        f'"n":{outcome.number},"wall":{wall:.3f}{_command_fields(outcome.command)},'
        f'"reply":{number_text(outcome.reply)}{reason}{stops}{_moments(outcome)}}}'
    )


def movement_line(planned: MovementPlanned, ended: MovementEnded, wall: float) -> str:
    """The line of a movement that nothing came between: its plan and how it went."""
    trajectory = ended.trajectory
    answers = "" if ended.answers else ',"answers":false'
    return (
        f"{_head(planned.time, 'move', planned.number, wall)}{_command_fields(planned.command)}"
        f'{_plan_fields(trajectory, planned.grip)},"end":{number_text(ended.time)},'
        f'"pose":{pose_text(ended.pose)}{_way_fields(trajectory, ended.stopped_by)}{answers}}}'
    )


def plan_line(planned: MovementPlanned, again: bool, wall: float) -> str:
    """The line of a movement that begins, or is planned `again` half way."""
    more = ',"again":true' if again else ""
    return (
        f"{_head(planned.time, 'plan', planned.number, wall)}{_command_fields(planned.command)}"
        f"{_plan_fields(planned.trajectory, planned.grip)}{_way_fields(planned.trajectory, '')}{more}}}"
    )


def end_line(ended: MovementEnded, wall: float) -> str:
    """The line of a movement that has ended some time after its plan was written."""
    answers = "" if ended.answers else ',"answers":false'
    return (
        f'{_head(ended.time, "end", ended.number, wall)},"pose":{pose_text(ended.pose)}'
        f"{_way_fields(ended.trajectory, ended.stopped_by)}{answers}}}"
    )


def action_line(done: ActionDone, number: int, wall: float) -> str:
    """The line of a person's action; `number` commands had been begun when it was done."""
    action = done.action
    refused = ',"refused":true' if done.refused else ""
    return (
        f'{{"t":{number_text(done.time)},"kind":"action","action":"{action.name}",'
        f'"n":{number},"wall":{wall:.3f},"source":{quoted(action.source)},'
        f'"arguments":{list_text(action.arguments)}{refused},'
        f'"text":{quoted(done.text)},"pose":{pose_text(done.pose)}}}'
    )


def belief_line(belief: Belief, wall: float) -> str:
    """The line of a believed pose."""
    spread = "" if belief.spread is None else f',"spread":{number_text(belief.spread)}'
    note = f',"note":{quoted(belief.note)}' if belief.note else ""
    particles = ""
    if belief.particles:
        places = nested_text([[float(value) for value in each] for each in belief.particles])
        particles = f',"particles":{places}'
    return (
        f'{{"t":{number_text(belief.time)},"kind":"belief","wall":{wall:.3f},'
        f'"believed":{pose_text(belief.pose)},"pose":{pose_text(belief.true)}{spread}{note}{particles}}}'
    )


def notice_line(notice: Notice, time: float, wall: float) -> str:
    """The line of a notice; it has no simulated time of its own."""
    subject = f',"subject":{quoted(notice.subject)}' if notice.subject else ""
    return (
        f'{{"t":{number_text(time)},"kind":"notice","wall":{wall:.3f},'
        f'"about":"{notice.kind}"{subject},"text":{quoted(notice.text)}}}'
    )


def mission_line(event: MissionEvent, wall: float) -> str:
    """The line of a goal met, or of a mission's beginning or end."""
    reason = f',"reason":{quoted(event.reason)}' if event.reason else ""
    return (
        f'{{"t":{number_text(event.time)},"kind":"mission","wall":{wall:.3f},'
        f'"subject":"{event.subject}","text":{quoted(event.text)}{reason}}}'
    )


def twin_line(twin: TwinReading, wall: float) -> str:
    """The line of a sensor read on the real robot and on its simulated twin."""
    return (
        f'{{"t":{number_text(twin.time)},"kind":"twin","wall":{wall:.3f}{_command_fields(twin.command)},'
        f'"code":{quoted(twin.code)},"robot":{number_text(twin.robot)},'
        f'"simulated":{number_text(twin.simulated)}}}'
    )


def state_line(beginning: Checkpoint, wall: float) -> str:
    """A line that says nothing new, but all that must be known to read on from here."""
    mission = beginning.mission
    fields: dict[str, object] = {
        "n": beginning.commands,
        "wall": round(wall, 3),
        "pose": _pose_list(beginning.pose),
        "block": [beginning.block.x, beginning.block.y, beginning.block.heading],
        "seed": beginning.seed,
        "holding": beginning.holding,
        "noise": beginning.noise,
        "paused": beginning.paused,
        "time_scale": beginning.time_scale,
        "contacts": beginning.contacts,
        "distance": beginning.distance,
        "client": beginning.client,
        "driving": beginning.spent.driving,
        "link": beginning.spent.link,
        "reading": dict(beginning.spent.by_sensor),
    }
    if mission is not None:
        fields["mission"] = {
            "goals": {goal.value: time for goal, time in mission.goals.items() if time is not None},
            "result": mission.result.value,
            "reason": mission.reason,
            "helped": mission.helped,
        }
    return f'{{"t":{number_text(beginning.time)},"kind":"state",{header_text(fields)[1:]}'


def pose_text(pose: Pose) -> str:
    """[x, y, heading]."""
    return list_text((pose.x, pose.y, pose.heading))


def header_text(fields: dict[str, object]) -> str:
    """The first line. It is written once, so its making may take its time."""
    return json.dumps(fields, separators=(",", ":"), allow_nan=False)


def _pose_list(pose: Pose) -> list[float]:
    return [float(pose.x), float(pose.y), float(pose.heading)]


def _head(time: float, kind: str, number: int, wall: float) -> str:
    return f'{{"t":{number_text(time)},"kind":"{kind}","n":{number},"wall":{wall:.3f}'


def _command_fields(command: Command) -> str:
    if command.source == USUAL_SOURCE:
        return f',"command":{quoted(command.text)}'
    return f',"command":{quoted(command.text)},"source":{quoted(command.source)}'


def _moments(outcome: CommandResult) -> str:
    """When it was taken up, and what the link took, where either is not 0 seconds away."""
    text = ""
    if outcome.taken is not None and outcome.taken != outcome.time and outcome.status is not Status.DONE:
        text = f',"taken":{number_text(outcome.taken)}'
    return f'{text},"link":{number_text(outcome.link)}' if outcome.link else text


def _plan_fields(trajectory: Trajectory, grip: Grip | None) -> str:
    if grip is not None:
        return (
            f',"grip":{{"closed":{_TRUTH[grip.closed]},"holding":{_TRUTH[grip.holding]},'
            f'"block":{pose_text(grip.block)}}}'
        )
    total = trajectory.totals
    return f',"total":{list_text((total.x, total.y, total.r))}'


def _way_fields(trajectory: Trajectory, stopped_by: str) -> str:
    """What kept a movement from its whole way."""
    text = "" if trajectory.contact is None else f',"contact":{_contact_text(trajectory.contact)}'
    if trajectory.rest_stop is not None:
        stop = trajectory.rest_stop
        text += f',"stop":[{stop.segment},{number_text(stop.turned)},{number_text(stop.translated)}]'
    return f'{text},"stopped_by":{quoted(stopped_by)}' if stopped_by else text


def _contact_text(contact: Contact) -> str:
    flags = "".join(f',"{name}":true' for name in ("ended", "drift", "held_block") if getattr(contact, name))
    cell = "" if contact.cell is None else f',"cell":[{contact.cell[0]},{contact.cell[1]}]'
    return (
        f'{{"t":{number_text(contact.time)},"at":[{contact.segment},{number_text(contact.turned)},'
        f'{number_text(contact.translated)}],"point":{list_text(contact.point)}{cell}{flags}}}'
    )
