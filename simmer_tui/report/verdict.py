"""The verdict on a run: how it ended, why, and what to try next. All screens, pages and reports show it.

The first of these decides: the goal met, a rule broken, the time limit, a crash of the program. A crash after
success stays a success, with a note. A crash before is a failure, and the crash is its cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum

from msgspec import Struct

from simmer_tui.report.cause_order import cause_of, cause_so_far
from simmer_tui.report.causes import Cause, Kind
from simmer_tui.report.device_differences import device_findings
from simmer_tui.report.finding import Finding
from simmer_tui.report.moments import (
    Moment,
    end_moment,
    fault_moment,
    lost_moment,
    moments_of,
    refusal_moment,
    told,
)
from simmer_tui.report.run_evidence import RunEvidence
from simmer_tui.run.attempt import Attempt, Task
from simmer_tui.run.events import Goal, NoticeKind, ProgramEnded, Result
from simmer_tui.run.history_rows import NoticeRow, ProgramRow
from simmer_tui.run.phrases import (
    capitalized,
    contacts_text,
    crash_text,
    last_output,
    program_end_text,
)
from simmer_tui.run.run_history import RunHistory
from simmer_tui.sim.command import counted


class Outcome(StrEnum):
    """Outcome of a run. A crash is a failure too."""

    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CRASHED = "crashed"
    ENDED = "ended"
    STILL_GOING = "still going"

    @property
    def is_failure(self) -> bool:
        """True if the run has failed."""
        return self in (Outcome.FAILED, Outcome.CRASHED)


class Verdict(Struct, frozen=True, kw_only=True):
    """The verdict. `elapsed` (seconds) and `line` (of the log, 0 without one) are the moment of the cause, or
    of the end where there is none."""

    outcome: Outcome
    text: str
    """Outcome and cause, the same everywhere."""
    elapsed: float
    line: int
    headline: str = ""
    """Outcome, and the end of the run."""
    goal: Goal | None = None
    """The goal reached last."""
    cause: Cause | None = None
    moments: tuple[Moment, ...] = ()
    """Facts of the run, in order."""
    evidence: tuple[str, ...] = ()
    advice: str = ""
    """The next thing to try."""
    notes: tuple[str, ...] = ()
    program: ProgramEnded | None = None
    """End of the program, if the simulator started it."""
    restart: str = ""
    """Words behind a time that counts from a restart, `Attempt.restart`."""

    @property
    def has_failed(self) -> bool:
        """True for a failed run, and if its program ended by itself with another exit code than 0."""
        program = self.program
        by_code = program is not None and program.exit_code != 0 and not program.stopped
        return self.outcome.is_failure or (self.outcome is Outcome.ENDED and by_code)

    @property
    def reasons(self) -> list[str]:
        """Sentences that support it."""
        return [each for each in (*self.notes, *self.evidence) if each]

    @property
    def last_moments(self) -> str:
        """The last two moments, in a line."""
        return "; ".join(each.sentence for each in self.moments[-2:])

    @property
    def beside(self) -> str:
        """The sentences of its cause that no moment tells."""
        text = "" if self.cause is None else f" {self.cause.text}"
        for each in self.moments:
            text = text.replace(told(each), "").replace(f" {each.text}.", "")
        return " ".join(text.split())

    @property
    def why(self) -> list[str]:
        """Sentences beside the moments: those of the cause, and those that support it."""
        return [each for each in (self.beside, *self.reasons) if each]

    @property
    def lines(self) -> list[str]:
        """All of it but the program's output: the sentence first, then its reasons."""
        # What the first sentence says is not said again.
        moments = [each.sentence for each in self.moments if each.text not in self.text]
        return [each for each in (self.text, *moments, *self.reasons, self.advice) if each]

    def plain(self) -> dict[str, object]:
        """The verdict for programs, without the program's output, whose times depend on the machine."""
        return {
            "outcome": self.outcome.value,
            "goal": None if self.goal is None else self.goal.value,
            "text": self.text,
            "time_s": self.elapsed,
            "line": self.line,
            "cause": _plain_cause(self.cause),
            "evidence": list(self.evidence),
            "next": self.advice or None,
            "notes": list(self.notes),
            "program": _plain_program(self.program),
        }


def _plain_cause(cause: Cause | None) -> dict[str, object] | None:
    if cause is None:
        return None
    return {
        "kind": cause.kind.value,
        "text": cause.text,
        "sure": cause.sure,
        "culprits": list(cause.culprits),
        "time_s": cause.elapsed,
        "line": cause.line,
        "tried": [{"change": each.change.value, "saved": each.saved} for each in cause.tried],
    }


def _plain_program(program: ProgramEnded | None) -> dict[str, object] | None:
    if program is None:
        return None
    return {
        "exit_code": program.exit_code,
        "signal": program.signal or None,
        "stopped": program.stopped,
        "error": program.error or None,
        "place": program.place or None,
    }


def verdict_of(
    history: RunHistory,
    task: Task | None,
    *,
    cut_off: bool = False,
    findings: Sequence[Finding] | None = None,
) -> Verdict:
    """The verdict on a run up to now.

    Args:
        history: All that happened.
        task: Limits of its mission; None without one.
        cut_off: True if the run was ended because real time was up.
        findings: Sensors and drives that are not as they should be; by default they are looked for.
    """
    return _Judge(history, task, cut_off, findings).verdict()


def findings_of(history: RunHistory, task: Task | None) -> tuple[Finding, ...]:
    """Sensors and drives that were not as they should be, until the mission's end; see `verdict_of`."""
    return device_findings(Attempt(history, task))


def goals_met(history: RunHistory) -> dict[Goal, float]:
    """Goals met since the last restart, in order, with the mission's time of each, seconds."""
    rows = (row for row in history.missions.items if row.order > history.began)
    return {row.event.subject: row.event.time for row in rows if isinstance(row.event.subject, Goal)}


class _Judge:
    """Facts and text of one verdict."""

    def __init__(
        self, history: RunHistory, task: Task | None, cut_off: bool, findings: Sequence[Finding] | None
    ) -> None:
        self._findings = findings
        self._history = history
        self._attempt = Attempt(history, task)
        self._is_mission = self._attempt.task is not None
        self._cut_off = cut_off
        self._ended, over = self._last_program(), self._attempt.over
        self._program = program = None if self._ended is None else self._ended.event
        by_itself = program is not None and program.crashed and not program.stopped
        self._crash = program if by_itself else None
        self._is_after_mission = bool(over and self._ended and self._ended.order > over.order)
        """True if the program ended only after its mission."""
        self._left = self._last_departure()
        self._goal = next(reversed(goals_met(history)), None)

    def verdict(self) -> Verdict:
        outcome, over = self._outcome(), self._attempt.over
        # Actions of the program after its mission's end did not decide it.
        program = None if self._is_after_mission else self._program
        needs_cause = self._needs_cause(outcome)
        found = self._findings
        if found is None:
            found = findings_of(self._history, self._attempt.task) if needs_cause else ()
        run = RunEvidence(self._attempt, program, cut_off=self._cut_off, findings=found)
        cause = None
        if needs_cause:
            cause = cause_so_far(run) if run.stopped else cause_of(run)
        if cause is not None and cause.kind is Kind.CRASHED and outcome is Outcome.FAILED:
            outcome = Outcome.CRASHED
        late = self._crash if self._is_after_mission else None
        moment = cause or over or self._ended or self._left or self._history
        return Verdict(
            outcome=outcome,
            headline=self._headline(outcome, run),
            text=self._text(outcome, cause, run),
            elapsed=moment.elapsed,
            line=moment.line,
            goal=self._goal,
            cause=cause,
            moments=moments_of(run, None if cause is None else cause.moment),
            evidence=() if cause is None else cause.evidence,
            advice=f"Try: {cause.advice}" if cause is not None and cause.advice else "",
            notes=() if late is None else (f"After that the program crashed: {crash_text(late)}.",),
            program=self._program,
            restart=self._attempt.restart,
        )

    # -- facts -----------------------------------------------------------------------------------

    def _last_program(self) -> ProgramRow | None:
        """The end of the program, unless another has come since."""
        history = self._history
        ended = [row for row in history.programs.items if row.order > history.began]
        if not ended:
            return None
        come = (row for row in history.notices.items if row.notice.kind in _GOES_ON)
        return None if any(row.order > ended[-1].order for row in come) else ended[-1]

    def _last_departure(self) -> NoticeRow | None:
        """The end of the last connection, if nobody is connected any more."""
        history = self._history
        rows = [row for row in history.notices.items if row.notice.kind in _CONNECTIONS]
        last = rows[-1] if rows else None
        gone = last is not None and last.notice.kind is NoticeKind.LEFT and last.order > history.began
        return last if gone else None

    def _outcome(self) -> Outcome:
        over = self._attempt.over
        if over is not None:
            if over.event.subject is Result.SUCCESS:
                return Outcome.SUCCEEDED
            # The referee ends the mission because the program has ended: the crash came first.
            crash_first = self._crash is not None and not self._is_after_mission
            return Outcome.CRASHED if crash_first else Outcome.FAILED
        if self._crash is not None:
            return Outcome.CRASHED
        if self._cut_off:
            return Outcome.FAILED
        if self._program is None:
            return Outcome.STILL_GOING if self._left is None else Outcome.ENDED
        # A program that sent no command is no success, whatever its exit code.
        silent = not self._program.stopped and self._attempt.is_silent
        return Outcome.FAILED if silent else Outcome.ENDED

    def _needs_cause(self, outcome: Outcome) -> bool:
        if outcome in (Outcome.SUCCEEDED, Outcome.STILL_GOING):
            return False
        if not self._is_mission:
            return outcome.is_failure
        return True if self._attempt.over is None else self._attempt.failed

    # -- text ------------------------------------------------------------------------------------

    def _began(self, outcome: Outcome) -> str:
        """The outcome, its time and the goal reached last, in words."""
        attempt, goal = self._attempt, self._goal
        # A mission's clock begins with its first command.
        lasted = attempt.elapsed - attempt.begun if outcome is Outcome.CRASHED else attempt.seconds
        when = f"{lasted:.1f} s{attempt.restart}" if attempt.restart else f"after {lasted:.1f} s"
        reached = outcome is not Outcome.SUCCEEDED and goal is not None
        return f"{outcome.value.capitalize()} {when}{f' (last goal: {goal})' if reached else ''}"

    def _headline(self, outcome: Outcome, run: RunEvidence) -> str:
        """The outcome, and how the run ended."""
        attempt, over, began = self._attempt, self._attempt.over, self._began(outcome)
        if outcome is Outcome.SUCCEEDED:
            return f"{began}, with {contacts_text(attempt.contacts)}."
        if outcome is Outcome.CRASHED and self._crash is not None:
            return f"{began}: {crash_text(self._crash)}."
        if outcome is Outcome.FAILED:
            return f"{began}: {'real time was up' if over is None else over.event.reason}."
        end, last = self._end(), run.last_command
        if self._is_mission and last is not None and outcome is Outcome.STILL_GOING:
            # Nobody knows what the program waits for; the last thing it did is a fact.
            done = counted(attempt.commands, "command")
            answered = f"the last, {last[0]}, was answered at {last[1]:.1f} s"
            return f"{began}: {done}; {answered}, and none has come since."
        how = f"{end}; " if end else ""
        return f"{began}: {how}{self._worst(run)}."

    def _text(self, outcome: Outcome, cause: Cause | None, run: RunEvidence) -> str:
        """The outcome and its cause."""
        crash, began = self._crash, self._began(outcome)
        if crash is not None and not crash.started:
            return f"{capitalized(program_end_text(crash))}.".replace("?.", "?")
        if cause is None:
            return self._headline(outcome, run)
        if crash is not None and outcome is Outcome.CRASHED:
            if cause.kind is not Kind.CRASHED:
                return f"{began}: {cause.text} Then: {crash_text(crash)}."
            return f"{self._headline(outcome, run)}{cause.text.removeprefix(told(cause.moment))}"
        stop = "its connection ended" if self._program is None else "the program was stopped"
        return f"{began}{f', when {stop}' if run.stopped else ''}: {cause.text}"

    def _end(self) -> str:
        """Words for the end of the program or of its connection; empty without one."""
        if self._program is not None:
            return program_end_text(self._program)
        return "" if self._left is None else self._left.text

    def _worst(self, run: RunEvidence) -> str:
        """The worst event of a run without a cause."""
        attempt, program = self._attempt, self._program
        first = end_moment if run.touched is not None else lost_moment
        moments = (first, lost_moment, fault_moment, refusal_moment)
        worst = next(filter(None, (moment(run) for moment in moments)), None)
        if worst is not None:
            return f"at {worst.elapsed:.1f} s, {worst.text}"
        if attempt.is_silent:
            return "no command was sent"
        wires = self._history.totals.wires
        done = counted(attempt.commands, "command") if attempt.commands else counted(wires, "serial message")
        if program is not None and program.exit_code and not program.stopped:
            # It has failed in its own opinion, and its last line says why at best.
            said, sent = last_output(program), self._history.unanswered
            waits = f"; its last message, '{sent[0]}' at {sent[1]:.1f} s, had no reply" if sent else ""
            return f"it printed {f'last: {said}' if said else 'nothing'}{waits}"
        if program is not None and program.exit_code:
            return f"{done} until then"
        is_counted = program is None and self._end().endswith(f" after {done}")
        return "nothing went wrong" if is_counted else f"{done}, nothing went wrong"


# A run that was taken over goes on, whatever had ended in the logged one.
_GOES_ON = (NoticeKind.CONNECTED, NoticeKind.TAKEN_OVER)
_CONNECTIONS = (*_GOES_ON, NoticeKind.LEFT)
