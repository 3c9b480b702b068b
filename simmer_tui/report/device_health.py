"""Readings and movements beside the errors that a run's own set declares, one by one: no statistics."""

from __future__ import annotations

from collections import Counter

import numpy as np
from msgspec import Struct

from simmer_tui.report.contact_evidence import SIGMAS
from simmer_tui.report.drive_audit import set_rule
from simmer_tui.report.finding import LEAST_SHARE
from simmer_tui.report.sensor_sample import by_sensor, sample_of
from simmer_tui.run.attempt import Attempt
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.table import Columns
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.command import counted
from simmer_tui.sim.specs import DriveSpec

_NAMED = 3
"""Devices named in a sentence."""


class DeviceHealth(Struct, frozen=True):
    """Numbers of readings and movements that could be compared, and of those beyond the errors that their set
    declares, by code."""

    readings: int = 0
    movements: int = 0
    beyond: tuple[tuple[str, int], ...] = ()

    @property
    def text(self) -> str:
        """A sentence; empty if nothing could be compared."""
        counts = ((self.readings, "reading"), (self.movements, "movement"))
        done = " and ".join(counted(count, noun) for count, noun in counts if count)
        if not done:
            return ""
        if not self.beyond:
            return f"Robot: {done} compared, all as exact as its set says."
        listed = ", ".join(f"{code} {count}" for code, count in self.beyond[:_NAMED])
        return f"Robot: {done} compared, of which some are further off than its set says: {listed}."


def health_of(seen: Attempt) -> DeviceHealth:
    """The readings and movements of an attempt; nothing of a real robot, whose truth no log has."""
    history, beyond = seen.history, Counter[str]()
    if history.is_twin:
        return DeviceHealth()
    readings = movements = 0
    for spec, rows in by_sensor(history, seen.within(history.readings)):
        sample = sample_of(history, rows, spec) if len(rows) else None
        # Answers of yes or no are wrong at a declared rate, not by a declared size.
        if sample is not None and not spec.is_yes_or_no:
            readings += len(sample.values)
            beyond[spec.code] = int((np.abs(sample.off(sample.expected)) > sample.tolerance).sum())
    moves, names = seen.within(history.movements), history.code_names
    for drive in (each for each in seen.spec.drives if each.code in names):
        off, allowed = _off_movements(history, moves[moves["code"] == names.index(drive.code)], drive)
        movements += len(off)
        beyond[drive.code] = int((off > allowed).sum())
    return DeviceHealth(readings, movements, tuple(each for each in beyond.most_common() if each[1]))


def _off_movements(history: RunHistory, moves: Columns, drive: DriveSpec) -> tuple[FloatArray, FloatArray]:
    """Sizes of the errors of movements on the drive's own axis, and the errors allowed for, (n,) each."""
    moves = moves[np.isfinite(moves["total_x"]) & np.isfinite(moves["asked"]) & (moves["asked"] != 0.0)]
    direction = np.array([drive.kind.direction.x, drive.kind.direction.y, drive.kind.direction.r])
    own = int(np.flatnonzero(direction)[0])
    axis, asked = "xyr"[own], moves["asked"].astype(np.float64) * drive.gain
    expected = asked * direction[own] * (1.0 + set_rule(history, moves, drive).biases[:, own])
    off = moves[f"total_{axis}"] - expected
    allowed = (LEAST_SHARE + SIGMAS * getattr(drive.error, axis)) * np.abs(asked)
    return np.abs(off), allowed
