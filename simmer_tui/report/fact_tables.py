"""Three tables of every run, with the same rows each time: its commands, its devices and its beliefs."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from simmer_tui.document.formats import COUNT, PASSAGE, number
from simmer_tui.document.model import DataColumn, DataTable, data_table
from simmer_tui.report.finding import Finding
from simmer_tui.report.robust_statistics import median_of
from simmer_tui.report.run_evidence import RunEvidence
from simmer_tui.run.table import Columns
from simmer_tui.sim.arrays import IntArray
from simmer_tui.sim.command import counted

NO_TRUTH = "this run has no truth: a real robot"
"""Text of rows that need the true pose, for a run without one."""
_LISTED = 6
"""Faults and codes named in a row."""

COMMAND_FACTS = data_table(
    "command_facts",
    "Commands in short",
    DataColumn("fact"),
    DataColumn("count", COUNT),
    DataColumn("text", PASSAGE, "what", wraps=True),
)
DEVICE_FACTS = data_table(
    "device_facts",
    "Sensors and drives in short",
    DataColumn("code"),
    DataColumn("kind"),
    DataColumn("count", COUNT, "used"),
    DataColumn("mean", number("+.3g"), "offset or gain"),
    DataColumn("text", PASSAGE, "against its set", wraps=True),
)
BELIEF_FACTS = data_table(
    "belief_facts",
    "Beliefs in short",
    DataColumn("fact"),
    DataColumn("count", COUNT),
    DataColumn("text", PASSAGE, "what", wraps=True),
)


def fact_tables(run: RunEvidence) -> tuple[DataTable, DataTable, DataTable]:
    """The tables of commands, devices and beliefs."""
    return (
        COMMAND_FACTS.filled(list(_commands(run))),
        DEVICE_FACTS.filled(list(_devices(run))),
        BELIEF_FACTS.filled(list(_beliefs(run))),
    )


# -- commands ----------------------------------------------------------------------------------------------


def _commands(run: RunEvidence) -> Iterator[tuple[object, ...]]:
    seen, history = run.seen, run.seen.history
    rows, names = seen.within(history.commands), history.code_names
    yield "sent", seen.commands, _by_code(seen.command_codes, names)
    refused = rows[rows["refused"]]
    yield "refused", len(refused), _by_code(refused["code"], names)
    faults = "; ".join(run.fault_text(each) for each in run.faults[:_LISTED])
    yield "faults on the wire", len(run.faults), faults
    unread = [s.code for s in seen.spec.sensors if s.enabled and s.code not in history.sensor_codes]
    yield "sensors never read", len(unread), " ".join(unread)
    alone = run.unseen_block
    yield "seen only by them", len(alone) or None, f"the block: {' '.join(alone)}" if alone else ""
    ends = (seen.elapsed, history.real_time if seen.over is None else np.nan)
    yield "longest silence", None, _longest_gap(rows, ends)
    told = ", and ".join(each.text for each in run.corrections)
    yield "corrections that do not shrink", run.corrections[0].count if run.corrections else 0, told
    again, of, example = _repeated(seen.within(history.movements), names)
    yield "repeated movements", again, f"of {of}, such as {example}" if again else ""


def _by_code(codes: IntArray, names: list[str]) -> str:
    numbers, counts = np.unique(codes, return_counts=True)
    order = np.argsort(-counts, kind="stable")[: 2 * _LISTED]
    return ", ".join(f"{names[numbers[place]]} {counts[place]}" for place in order)


def _longest_gap(rows: Columns, ends: tuple[float, float]) -> str:
    """The longest time without an answer, simulated and real, the one until the end included."""
    if not len(rows):
        return ""
    parts = []
    for column, kind, end in zip(("elapsed", "real_time"), ("simulated", "real"), ends, strict=True):
        gaps = np.diff(rows[column].astype(np.float64), append=end)
        if np.isfinite(gaps).any():
            place = int(np.nanargmax(gaps))
            parts.append(f"{gaps[place]:.1f} {kind} s after {rows['elapsed'][place]:.1f} s")
    return ", ".join(parts)


def _repeated(moves: Columns, names: list[str]) -> tuple[int, int, str]:
    """Movements that repeat the one before with nothing between, of how many, and the first of them."""
    moves = moves[np.isfinite(moves["asked"]) & (moves["asked"] != 0.0) & ~moves["grips"]]
    steps = (np.diff(moves[name], prepend=-1) for name in ("number", "code", "asked"))
    number_step, code_step, asked_step = steps
    rows = moves[(number_step == 1) & (code_step == 0) & (asked_step == 0.0)]
    example = f"{names[rows['code'][0]]}-{rows['asked'][0]:g}" if len(rows) else ""
    return len(rows), len(moves), example


# -- devices -----------------------------------------------------------------------------------------------


def _devices(run: RunEvidence) -> Iterator[tuple[object, ...]]:
    seen, history = run.seen, run.seen.history
    readings, moves = seen.within(history.readings), seen.within(history.movements)
    for sensor in (each for each in seen.spec.sensors if each.enabled):
        codes = history.sensor_codes
        place = codes.index(sensor.code) if sensor.code in codes else -1
        mine = readings[readings["sensor"] == place]
        errors = mine["error"][np.isfinite(mine["error"])]
        mean = float(errors.mean()) if len(errors) and not history.is_twin else None
        yield sensor.code, "sensor", len(mine), mean, _told(run, sensor.code, len(mine), "reading")
    for drive in (each for each in seen.spec.drives if each.enabled):
        place = history.code_names.index(drive.code) if drive.code in history.code_names else -1
        mine = moves[(moves["code"] == place) & np.isfinite(moves["asked"]) & (moves["asked"] != 0.0)]
        gain = None
        if len(mine) and not history.is_twin:
            axis = "total_r" if drive.kind.turns else "total_x" if drive.kind.direction.x else "total_y"
            sign = drive.kind.direction.x + drive.kind.direction.y + drive.kind.direction.r
            gain = median_of(mine[axis] * sign / mine["asked"])
        yield drive.code, "drive", len(mine), gain, _told(run, drive.code, len(mine), "movement")


def _told(run: RunEvidence, code: str, count: int, noun: str) -> str:
    found: list[Finding] = [each for each in run.findings if each.of == code]
    if run.seen.history.is_twin:
        return NO_TRUTH
    if found:
        return "; ".join(each.text.removeprefix(f"{code} ") for each in found)
    if not count:
        return "never read" if noun == "reading" else "never used"
    if code in run.declared:
        return f"as its set says: {run.declared[code]}"
    nominal = run.seen.history.nominal
    usual = {} if nominal is None else {each.code: each for each in nominal.spec.sensors}
    own = next((each for each in run.seen.spec.sensors if each.code == code), None)
    if nominal is None or own is None or code not in usual or usual[code].kind is not own.kind:
        return "as its set says"
    differ = [
        f"its {column.name} is {column.rule.shown(mine)}, in {nominal.name} {column.rule.shown(other)}"
        for column in own.kind.columns
        if (mine := getattr(own, column.field)) != (other := getattr(usual[code], column.field))
    ]
    return "; ".join(["as its set says", *differ])


# -- beliefs -----------------------------------------------------------------------------------------------


def _beliefs(run: RunEvidence) -> Iterator[tuple[object, ...]]:
    facts = run.belief
    rows, sure = facts.rows, facts.sure
    share = "none sent"
    if len(rows):
        share = f"{100 * len(sure) / len(rows):.0f} % of {counted(len(rows), 'belief')}"
    yield "sure", len(sure), share
    if not facts.has_truth:
        yield from ((name, None, NO_TRUTH) for name in ("error", "constant offset", "steps"))
        return
    error = ""
    if len(sure):
        off, turn = median_of(sure["distance"]), median_of(np.abs(sure["turn"]))
        error = f"{off:.1f} in and {turn:.0f} deg, the median of the sure ones"
    yield "error", len(sure), error
    yield "constant offset", None, "" if facts.constant is None else facts.constant.text
    yield "steps", None, "; or ".join(each.text for each in facts.steps)
