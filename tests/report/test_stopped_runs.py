"""Runs that were stopped before their mission was over: they have a cause as far as they went."""

from __future__ import annotations

from typing import Any

import pytest

from simmer_tui.report.causes import Kind
from simmer_tui.report.finding import Basis, Finding, FindingKind
from simmer_tui.report.verdict import Outcome, Verdict, verdict_of
from simmer_tui.run.events import Notice, NoticeKind, OutputLine, ProgramEnded
from tests.report import test_causes
from tests.report.test_causes import Mission, correct


def begin(**changes: Any) -> Mission:
    """A mission that has begun, as the referee says it."""
    mission = test_causes.begin(**changes)
    mission.referee.begin()
    return mission


def stopped(
    mission: Mission, waited: float = 0.0, words: str = "", findings: tuple[Finding, ...] = ()
) -> Verdict:
    """The verdict on a run whose program a person stops after some real seconds."""
    mission.history.real_time = waited
    said = (OutputLine(0.0, words),) if words else ()
    mission.history.add_program_end(ProgramEnded(0.0, 143, signal="SIGTERM", stopped=True, stderr=said))
    return verdict_of(mission.history, mission.task, findings=findings)


def test_a_run_that_shows_nothing_was_only_stopped() -> None:
    mission = begin()
    mission.give("u1", "u5", "d1-2", "u1", "d1-2")
    verdict = stopped(mission)
    assert (verdict.outcome, verdict.cause) == (Outcome.ENDED, None)
    assert verdict.text == "Ended after 0.8 s: the program was stopped; 5 commands until then."


def test_a_wrong_sensor_of_a_stopped_run_is_its_cause() -> None:
    mission = begin()
    mission.give(*("g1", "r1-20") * 3)
    text = "g1 reads with the wrong sign (9 readings)"
    verdict = stopped(
        mission, findings=(Finding("g1", FindingKind.SIGN, -1.0, -1.0, -1.0, "", 9, Basis.NOMINAL, text),)
    )
    assert verdict.cause is not None
    assert (verdict.cause.kind, verdict.cause.culprits) == (Kind.SENSOR_WRONG, ("g1",))
    assert ", when the program was stopped: g1 reads with the wrong sign" in verdict.text
    assert verdict.moments[-1].text == "the program was stopped"
    assert not verdict.has_failed


def test_a_stopped_run_that_was_lost_says_since_when_and_not_that_it_ended_by_itself() -> None:
    mission = begin()
    mission.give("u1", "d1-1")
    mission.believe()
    mission.give("u1", "d1-1")
    mission.believe(ahead=14.0)
    verdict = stopped(mission)
    assert verdict.cause is not None
    assert verdict.cause.kind is Kind.LOST
    assert ": it was lost from then on." in verdict.text
    assert "ended by itself" not in verdict.text


def test_who_is_stopped_may_still_find_its_place() -> None:
    mission = begin()
    mission.give("u1", "d1-1")
    mission.believe(ahead=3.0, spread=8.0)
    assert stopped(mission).cause is None


def test_corrections_of_a_stopped_run_name_their_drive() -> None:
    mission = begin(noise=True)
    correct(mission, -1.0)
    verdict = stopped(mission)
    assert verdict.cause is not None
    assert (verdict.cause.kind, verdict.cause.culprits) == (Kind.GOT_NOWHERE, ("r1",))
    assert verdict.advice.startswith("Try: Check the sign of r1's value")


@pytest.mark.parametrize(("waited", "is_silent"), [(44.0, True), (2.0, False)])
def test_a_program_that_hangs_until_it_is_stopped_is_silent(waited: float, is_silent: bool) -> None:
    mission = begin()
    mission.give("u1", "d1-1")
    verdict = stopped(mission, waited, "team.py:12: waits for its lock")
    assert (verdict.cause is not None and verdict.cause.kind is Kind.SILENCE) is is_silent
    said = (
        "d1-1 was answered, and no command came after it until the program was stopped, 44 s of real time "
        "later. Its last output: team.py:12"
    )
    assert (said in verdict.text) is is_silent


def test_the_end_of_a_connection_stops_a_run_too_and_is_no_silence() -> None:
    mission = begin(noise=True)
    correct(mission, -1.0)
    mission.engine.tell(Notice(NoticeKind.CONNECTED, "client 1 connected", subject="1"))
    mission.engine.tell(Notice(NoticeKind.LEFT, "client 1 disconnected", subject="1"))
    mission.history.real_time = 60.0
    verdict = verdict_of(mission.history, mission.task)
    assert verdict.cause is not None
    assert verdict.cause.kind is Kind.GOT_NOWHERE
    assert ", when its connection ended: " in verdict.text
