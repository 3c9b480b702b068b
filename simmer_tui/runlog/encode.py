"""The records of the events of a run, in order.

Each event has a record of its own. Two things are left out since they would be most of a log's bytes: the
pose of a robot that stands, which the record of its last motion has, and a scan that was read before. A
checkpoint has the pose, and the first scan after it is written again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

from msgspec.structs import replace

from simmer_tui.run.events import (
    ActionDone,
    Belief,
    CommandResult,
    Event,
    LegBegun,
    LegEnded,
    MissionEvent,
    MovementEnded,
    MovementPlanned,
    Notice,
    ProgramEnded,
)
from simmer_tui.run.state import Checkpoint
from simmer_tui.runlog.line_form import AXES_FORM, NUMBER_FORM, line_form, logged_number, logged_pose
from simmer_tui.runlog.log_records import (
    CONTACT_FORM,
    GRIP_FORM,
    NO_DELAY,
    PLACE_FORM,
    RECORDS,
    USUAL_SOURCE,
    ActionRecord,
    AnswerRecord,
    BeliefRecord,
    CheckpointRecord,
    EndRecord,
    LoggedPose,
    LogRecord,
    NoticeRecord,
    PlanRecord,
    ReadingRecord,
    packed_particles,
)
from simmer_tui.runlog.logged_scans import packed_ranges
from simmer_tui.sim.records import LidarScan, Reading, Status

LARGE_GRID = 2000
"""States of a grid beyond which a log has only some of its cells: at 10 Hz they would be 100 MB an hour."""
# Just below half a second: five times a tenth may round to less.
GRID_EVERY = 0.499
"""Simulated seconds between two large grids with their cells."""
_RECORDS: dict[type | None, type[LogRecord]] = {record.event: record for record in RECORDS}
"""The kind of record of each kind of event."""


class LogEncoder:
    """Makes the records of events.

    Every record of a large grid has its numbers, two a second have its cells. Before a movement, a contact
    and the end, the last belief has one more record, with its cells.
    """

    def __init__(self, pose: LoggedPose, present: Callable[[], tuple[int, float]]) -> None:
        """Args:
        pose: Pose of the robot in the header.
        present: Gives the number of commands begun so far, and simulated time.
        """
        self._pose: LoggedPose | None = pose
        """The pose of the last record that has one, beliefs apart."""
        self._present = present
        self._reading_form = line_form(ReadingRecord)
        self._under_way = 0
        """The number of the movement under way, or 0."""
        self._answered: int | None = None
        """The number of the movement whose end was its answer too."""
        self._stood_since: float | None = -math.inf
        """Simulated time of the end of the last leg; None while one is under way."""
        self._grid_kept = -math.inf
        """Simulated time of the last large grid with its cells."""
        self._without_cells: Belief | None = None
        """The newest belief, if its record has no cells."""
        self._scans: dict[str, LidarScan] = {}
        """The newest scan of each lidar that a record has since reading can begin."""

    def records(self, event: Event, real_time: float) -> Iterator[LogRecord]:
        """The records to write at an event, which may include one more of the last belief.

        Args:
            real_time: Seconds since the log began.
        """
        real_time = round(real_time, 3)  # whole milliseconds: no timer of a run is finer
        if self._without_cells is not None and self._shows_belief(event):
            yield from self._cells_of_belief(real_time)
        record = self._record(event, real_time)
        if record is not None:
            # The cells of a belief come later than the belief: the robot may be elsewhere by then.
            if not isinstance(record, BeliefRecord):
                self._pose = getattr(record, "pose", None) or self._pose
            yield record

    def _record(self, event: Event, real_time: float) -> LogRecord | None:
        # Readings and movements by hand, in half of the time that `line_form` takes: they are nearly all
        # lines of a log, as for the decoder.
        match event:
            case CommandResult():
                # The end of a movement may have been its answer. Numbers restart after a reset: an earlier
                # movement must not answer for a later one.
                answered, self._answered = self._answered, None
                reading = event.reading
                if reading is not None and event.status is Status.READING:
                    if reading.scan is not None:
                        return self._scan_record(event, reading, reading.scan, real_time)
                    return self._reading_record(event, reading, real_time)
                if event.number == answered:
                    return None
                return line_form(AnswerRecord).record(event, {"pose": self._pose}, real_time=real_time)
            case MovementPlanned():
                # A block moved on the way changes the plan of the same command.
                again, self._under_way = event.number == self._under_way, event.number
                return PlanRecord(**_movement(event, real_time), again=again)
            case Belief():
                return self._belief_record(self._thinned(event), real_time)
            case ActionDone():
                return line_form(ActionRecord).record(event, real_time=real_time, n=self._present()[0])
            case Notice():
                time = self._present()[1] if event.moment is None else event.moment
                return line_form(NoticeRecord).record(event, real_time=real_time, t=time)
            case MovementEnded():
                self._under_way, self._answered = 0, event.number if event.answers else None
                return EndRecord(
                    **_movement(event, real_time),
                    pose=logged_pose(event.pose),
                    stopped_by=event.stopped_by,
                    answers=event.answers,
                )
            case LegBegun():
                self._stood_since = None
            case LegEnded():
                self._stood_since = event.time
        return line_form(_RECORDS[type(event)]).record(event, real_time=real_time)

    def _shows_belief(self, event: Event) -> bool:
        """True for events that a belief led to, or is compared with: a movement, a contact, the end."""
        match event:
            case MovementPlanned():
                return True
            case LegBegun():
                # A leg that follows another at once continues its movement.
                return self._stood_since not in (None, event.time)
            case MovementEnded() | LegEnded():
                return event.contact is not None
            case MissionEvent():
                return event.over
        return isinstance(event, ProgramEnded)

    def _thinned(self, belief: Belief) -> Belief:
        """A belief as its record has it."""
        grid, self._without_cells = belief.grid, None
        if grid is None or not grid.cells or belief.again or grid.states <= LARGE_GRID:
            return belief
        # Time restarts after a reset.
        if 0.0 <= belief.time - self._grid_kept < GRID_EVERY:
            self._without_cells = belief
            return replace(belief, grid=replace(grid, cells=b""))
        self._grid_kept = belief.time
        return belief

    def _cells_of_belief(self, real_time: float) -> Iterator[LogRecord]:
        belief, self._without_cells = self._without_cells, None
        if belief is not None:
            self._grid_kept = belief.time
            # Its note and its particles are in an earlier record.
            yield self._belief_record(replace(belief, particles=(), again=True), real_time)

    def checkpoint(self, checkpoint: Checkpoint, real_time: float) -> CheckpointRecord:
        """The record of a checkpoint. Reading can begin there: later records refer to none before."""
        self._scans.clear()
        record = line_form(CheckpointRecord).record(checkpoint, real_time=round(real_time, 3))
        self._pose = record.pose
        return record

    def rest(self, real_time: float) -> Iterator[LogRecord]:
        """The record that is still missing at the end: of the cells of the newest belief."""
        return self._cells_of_belief(round(real_time, 3))

    def _reading_record(self, result: CommandResult, reading: Reading, real_time: float) -> LogRecord:
        time, link, source = result.time, result.link, result.command.source
        pose, before = logged_pose(result.pose), logged_pose(result.before)
        reply, true = logged_number(result.reply), logged_number(reading.true)
        return ReadingRecord(
            t=time,
            real_time=real_time,
            n=result.number,
            command=result.command.text,
            source=USUAL_SOURCE if source == USUAL_SOURCE else source,
            taken=None if result.taken == time else result.taken,
            link=link if link else NO_DELAY,
            pose=None if pose == self._pose else pose,
            before=None if before == pose else before,
            reply=reply,
            true=None if true == reply else true,
        )

    def _scan_record(
        self, result: CommandResult, reading: Reading, scan: LidarScan, real_time: float
    ) -> LogRecord:
        known = {"pose": self._pose, "reply": NUMBER_FORM.written(result.reply)}
        fields: dict[str, Any] = {"revolution": scan.revolution}
        # A program may ask ten times for the same revolution.
        if self._scans.get(reading.sensor.code) is not scan:
            self._scans[reading.sensor.code] = scan
            fields["scan"], fields["floats"] = packed_ranges(scan.ranges, reading.sensor.resolution)
        return self._reading_form.record(result, known, real_time=real_time, **fields)

    def _belief_record(self, belief: Belief, real_time: float) -> LogRecord:
        particles, known = packed_particles(belief.particles, logged_pose(belief.pose)), {"pose": self._pose}
        return line_form(BeliefRecord).record(belief, known, real_time=real_time, particles=particles)


def _movement(event: MovementPlanned | MovementEnded, real_time: float) -> dict[str, Any]:
    """The fields that the records of a movement's plan and of its end share. Defaults are left out."""
    path, source, contact = event.trajectory, event.command.source, event.trajectory.contact
    fields: dict[str, Any] = {
        "t": event.time,
        "real_time": real_time,
        "n": event.number,
        "command": event.command.text,
        "source": USUAL_SOURCE if source == USUAL_SOURCE else source,
        "origin": logged_pose(path.before),
        "total": AXES_FORM.written(path.totals),
    }
    if path.start_time != event.time:
        fields["begin"] = path.start_time
    if contact is not None:
        fields["contact"] = CONTACT_FORM.written(contact)
    if path.rest_stop is not None:
        fields["stop"] = PLACE_FORM.written(path.rest_stop)
    if event.grip is not None:
        fields["grip"] = GRIP_FORM.written(event.grip)
    return fields
