"""Row 0: the state of a run, and at its end the headline."""

from collections.abc import Mapping
from enum import StrEnum

from simmer_tui.live.snapshot import Snapshot
from simmer_tui.report.verdict import Outcome
from simmer_tui.run.events import Result
from simmer_tui.run.phrases import contacts_text, crash_text, program_end_text
from simmer_tui.sim.command import counted, cut
from simmer_tui.tui.event_text import clock_text
from simmer_tui.tui.line_panel import StyledLine, between, length
from simmer_tui.tui.readouts import ROOMY, Room

_LONGEST = 160
"""Characters of a cause: no terminal that can be read at a glance is wider."""


class RunPhase(StrEnum):
    """Phases of a run in row 0. Each has a colour of its own; `going` and `ended` have the colours of
    bars."""

    WAITING = "waiting"
    GOING = "going"
    PAUSED = "paused"
    ENDED = "ended"
    SUCCESS = "success"
    FAILURE = "failure"

    @property
    def is_over(self) -> bool:
        """True once the run has a verdict, or its program has ended."""
        return self in (RunPhase.ENDED, RunPhase.SUCCESS, RunPhase.FAILURE)


def phase_of(snapshot: Snapshot, ports: Mapping[str, int]) -> RunPhase:
    """The phase of a run: first a crash, then the mission's verdict, a pause, and the present state."""
    mission, verdict, state = snapshot.mission, snapshot.verdict, snapshot.state
    if mission is not None and mission.over:
        return RunPhase.SUCCESS if mission.result is Result.SUCCESS else RunPhase.FAILURE
    if verdict is not None and verdict.has_failed:
        return RunPhase.FAILURE
    if state.paused:
        return RunPhase.PAUSED
    if verdict is not None and verdict.outcome is Outcome.ENDED:
        return RunPhase.ENDED
    is_new = not state.commands and not state.client and not state.moving
    return RunPhase.WAITING if is_new and ports else RunPhase.GOING


_ICONS = {
    RunPhase.WAITING: ("○", "o"),
    RunPhase.GOING: ("●", "*"),
    RunPhase.PAUSED: ("‖", "||"),
    RunPhase.ENDED: ("■", "#"),
    RunPhase.SUCCESS: ("✓", "OK"),
    RunPhase.FAILURE: ("✗", "X"),
}
_CRASH_ICON = "!"
_ADVICE = ("?", "CHECK THE PROGRAM")
"""Icon and word for a program with a mistake in its connection."""


def header_line(snapshot: Snapshot, room: Room) -> StyledLine:
    """Row 0: icon and word of the phase, its text, and the time."""
    phase = phase_of(snapshot, room.ports)
    word, text = _words(snapshot, room, phase)
    crashed = word == _CRASHED
    icon = _CRASH_ICON if crashed else _ICONS[phase][room.plain]
    going = phase is RunPhase.GOING
    left: StyledLine = ((f" {icon} ", "robot" if going else "bold"), (word, "bold"))
    if snapshot.advice and phase in (RunPhase.WAITING, RunPhase.GOING):
        icon, word = _ADVICE
        left, text = ((f" {icon} {word}", "warning" if going else "bold"),), cut(snapshot.advice, _LONGEST)
        phase = RunPhase.GOING  # the one with the shortest right end
    right: StyledLine = ((f"{_right(snapshot, room, phase)} ", "plain"),)
    # Three blanks before the text, and at least one after it.
    free = room.width - length(left) - length(right) - 4
    if free > 0 and text:
        shown = text if len(text) <= free else f"{text[: free - 1]}…"
        left = (*left, (f"   {shown}", "plain"))
    return between(left, right, room.width)


_CRASHED = "PROGRAM CRASHED"


def _words(snapshot: Snapshot, room: Room, phase: RunPhase) -> tuple[str, str]:
    """Word of a phase, and the text behind it."""
    state = snapshot.state
    match phase:
        case RunPhase.WAITING:
            return ("WAITING for a program" if room.width >= _WORDY else "WAITING"), _ports(room)
        case RunPhase.PAUSED:
            waits = "a command waits; " if snapshot.waiting else ""
            where = f"the robot is at {state.pose.x:.1f}, {state.pose.y:.1f}; "
            return "PAUSED", f"{where if room.width >= _WORDY else ''}{waits}b continues"
        case RunPhase.SUCCESS:
            assert snapshot.mission is not None, "only missions succeed"
            # The program's actions after the mission are not judged.
            return "MISSION SUCCEEDED", f"block in the drop zone, {contacts_text(snapshot.mission.contacts)}"
        case RunPhase.ENDED:
            return "PROGRAM ENDED", _ending(snapshot)
        case RunPhase.FAILURE:
            return _failure_words(snapshot)
    return ("driving" if state.moving else "standing"), "   ".join(filter(None, _driver(snapshot, room)))


def _failure_words(snapshot: Snapshot) -> tuple[str, str]:
    mission, verdict = snapshot.mission, snapshot.verdict
    program = None if verdict is None else verdict.program
    if mission is not None and mission.over:
        if verdict is not None and verdict.outcome is Outcome.CRASHED and program is not None:
            return "MISSION FAILED", program_end_text(program)
        return "MISSION FAILED", cut(mission.reason, _LONGEST)
    assert verdict is not None, "without a mission the verdict says that it failed"
    if program is not None and program.crashed and program.started:
        return _CRASHED, crash_text(program)
    return "PROGRAM FAILED", cut(verdict.text, _LONGEST)


# Half a usual screen, and the columns of the icon, the word and the time.
_WORDY = 60
"""Columns from which there is room for whole phrases."""


def _ports(room: Room) -> str:
    """Ports for a program, with the purpose of each if there is room."""
    named = room.ports.items()
    return "ports " + ", ".join(
        f"{port} {name}" if room.width >= ROOMY else f"{port}" for name, port in named
    )


def _driver(snapshot: Snapshot, room: Room) -> list[str]:
    """Name of the program that drives, its commands a second, the pace and the seed."""
    state, roomy = snapshot.state, room.width >= ROOMY
    who = state.client
    if who and room.program:
        who = room.program
    elif who and not roomy:
        who = who.rpartition(":")[0] or who
    if not room.ports:
        who = room.name
    elif not who:
        who = f"no program   {_ports(room)}"
    rate = f"{snapshot.rate:.0f}{' commands' if roomy else ''}/s" if state.client else ""
    seed = f"seed {state.seed}{'' if state.noise else ', noise off'}" if roomy else ""
    return [who, rate, snapshot.pace_text, seed]


def _ending(snapshot: Snapshot) -> str:
    """The end of a program that ended by itself."""
    verdict = snapshot.verdict
    assert verdict is not None, "it has ended"
    commands = counted(snapshot.state.commands, "command")
    program = verdict.program
    if program is None:
        return f"it has disconnected, {commands}"
    if program.stopped:
        return f"the simulator ended it, {commands}"
    return f"exit code {program.exit_code}, {commands}"


def _right(snapshot: Snapshot, room: Room, phase: RunPhase) -> str:
    """The time; at a mission's verdict with its limit; before the first client also the seed."""
    state, mission, verdict = snapshot.state, snapshot.mission, snapshot.verdict
    if mission is not None and mission.over:
        minutes, seconds = divmod(round(mission.plan.time_limit), 60)
        return f"{clock_text(mission.time)} of {minutes}:{seconds:02d}"
    time = state.time
    if phase.is_over and verdict is not None and verdict.program is not None:
        time = verdict.program.time
    return f"seed {state.seed}   {clock_text(time)}" if phase is RunPhase.WAITING else clock_text(time)
