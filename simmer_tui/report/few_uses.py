"""Devices that were used too seldom for a test: each reading or movement beside its declared error."""

from __future__ import annotations

import numpy as np

from simmer_tui.report.contact_evidence import SIGMAS
from simmer_tui.report.drive_audit import set_rule
from simmer_tui.report.finding import LEAST_SHARE
from simmer_tui.report.sensor_sample import sample_of
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.table import Columns
from simmer_tui.sim.specs import DriveSpec, SensorSpec

_WITHIN = "within the declared error"


def few_readings(history: RunHistory, rows: Columns, sensor: SensorSpec) -> str:
    """The readings of a sensor beside what its set expects, in words; empty where that is not known."""
    sample = sample_of(history, rows, sensor)
    if sample is None or not len(sample.values):
        return ""
    off = sample.off(sample.expected)
    if (np.abs(off) <= sample.tolerance).any():
        return _WITHIN if (np.abs(off) <= sample.tolerance).all() else "some beyond the declared error"
    return f"each beyond the declared error, by {np.median(off):+.2g} {sensor.unit}".rstrip()


def few_movements(history: RunHistory, moves: Columns, drive: DriveSpec) -> str:
    """The movements of a drive beside what its set expects on its own axis, in words; empty where that is not
    known."""
    moves = moves[np.isfinite(moves["total_x"])]
    if not len(moves):
        return ""
    direction = np.array([drive.kind.direction.x, drive.kind.direction.y, drive.kind.direction.r])
    own = int(np.flatnonzero(direction)[0])
    axis = "xyr"[own]
    asked = moves["asked"].astype(np.float64) * drive.gain
    expected = asked * direction[own] * (1.0 + set_rule(history, moves, drive).biases[:, own])
    off = moves[f"total_{axis}"] - expected
    allowed = (LEAST_SHARE + SIGMAS * getattr(drive.error, axis)) * np.abs(asked)
    beyond = np.abs(off) > allowed
    if not beyond.all():
        return "some beyond the declared error" if beyond.any() else _WITHIN
    share = float(np.median(off * direction[own] / np.where(asked, asked, np.nan)))
    return f"each beyond the declared error, by {100.0 * share:+.0f} %"
