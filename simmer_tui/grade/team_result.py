"""Result of each team, as table, pages and files for other programs show it."""

from __future__ import annotations

import hashlib
import hmac
from collections import Counter
from dataclasses import dataclass
from enum import StrEnum

from simmer_tui.document.formats import ESTIMATE
from simmer_tui.grade.course import LONG, shown_name
from simmer_tui.grade.grade_folder import Entry, GradeFolder
from simmer_tui.report.causes import Kind
from simmer_tui.trials.intervals import IntervalEstimate, median
from simmer_tui.trials.sequential import Decision
from simmer_tui.trials.trial import TrialResult
from simmer_tui.trials.trials_summary import failure_text

# Causes that fit into a cell of the table.
_CAUSES = 5
_CODE = 10
"""Hexadecimal digits of a code: two of a thousand teams have the same one once in a million courses."""


class TeamStatus(StrEnum):
    """Status of a team."""

    PASSED = "passed"
    FAILED = "failed"
    REFUSED = "refused"
    """Its files or its robot are against the rules; it was not run."""
    UNDER_WAY = "under way"


@dataclass(frozen=True, slots=True, kw_only=True)
class TeamResult:
    """The result of a team. `score` is None before the decision; `time` is the median of successful runs,
    simulated seconds, `contacts` their number a run; `causes` are the causes of failed runs, the most
    frequent first."""

    entry: Entry
    label: str
    """The team's name, or the code that represents it."""
    slug: str
    """The same for names of files; no two have the same."""
    status: TeamStatus
    score: IntervalEstimate | None
    results: list[TrialResult]
    time: float | None
    contacts: float | None
    causes: list[tuple[str, int]]

    @property
    def runs(self) -> int:
        """Number of runs that count."""
        return len(self.results)

    @property
    def successes(self) -> int:
        """Number of runs that did the mission."""
        return sum(result.success for result in self.results)

    @property
    def never_started(self) -> bool:
        """True if its program has run and never sent a command."""
        return bool(self.results) and all(result.sent_nothing for result in self.results)

    @property
    def summary(self) -> str:
        """The status in one line."""
        if self.status is TeamStatus.REFUSED:
            return "; ".join(shown_name(str(problem), LONG) for problem in self.entry.problems)
        if self.score is None:
            return f"{self.successes} of {self.runs} runs so far"
        return f"success rate {ESTIMATE.text(self.score)}, {self.successes} of {self.runs} runs"


def team_results(folder: GradeFolder, *, hidden: bool) -> list[TeamResult]:
    """All teams, in the order of the course; `hidden` puts codes in place of names."""
    return [_team_result(folder, entry, hidden=hidden) for entry in folder.entries]


def ranked(all_of_them: list[TeamResult]) -> list[TeamResult]:
    """The results, the best team first."""

    def place(each: TeamResult) -> tuple[bool, float, float, float]:
        score, time = each.score, each.time
        return (
            each.status is not TeamStatus.PASSED,
            -score.value if score else 1.0,
            -score.low if score else 1.0,
            time or 0.0,
        )

    return sorted(all_of_them, key=place)


def code_of(folder: GradeFolder, entry: Entry) -> str:
    """Code of a team where names are hidden: the team can be found only with the seed."""
    name = entry.team.name.encode(errors="surrogatepass")
    digest = hmac.new(str(folder.plan.seed).encode(), name, hashlib.sha256)
    return f"team {digest.hexdigest()[:_CODE]}"


def _team_result(folder: GradeFolder, entry: Entry, *, hidden: bool) -> TeamResult:
    decision, results = folder.decision(entry), folder.counted(entry)
    score = None if decision is None else folder.test.interval(decision.runs, decision.successes)
    causes = Counter(_reason(result) for result in results if not result.success)
    code = code_of(folder, entry)
    return TeamResult(
        entry=entry,
        label=code if hidden else shown_name(entry.team.name),
        slug=code.replace(" ", "-") if hidden else entry.team.slug,
        status=_status(entry, decision),
        score=score,
        results=results,
        time=median([result.time for result in results if result.success]),
        contacts=sum(result.contacts for result in results) / len(results) if results else None,
        causes=[(cause, number) for cause, number in causes.most_common(_CAUSES)],
    )


def _reason(result: TrialResult) -> str:
    """Reason why a run failed, the same for runs that failed alike."""
    cause = result.verdict.get("cause") or {}
    # "The program ended" is no reason where its verdict has the error that ended it.
    if cause.get("kind") == Kind.CRASHED.value:
        return str(cause["text"])
    return result.reason or result.ending.value


def _status(entry: Entry, decision: Decision | None) -> TeamStatus:
    if entry.problems:
        return TeamStatus.REFUSED
    if decision is None:
        return TeamStatus.UNDER_WAY
    return TeamStatus.PASSED if decision.passed else TeamStatus.FAILED


def last_failure(team_result: TeamResult) -> str:
    """Cause of the last failed run, or empty."""
    failed = [result for result in team_result.results if not result.success]
    return failure_text(failed[-1]) if failed else ""
