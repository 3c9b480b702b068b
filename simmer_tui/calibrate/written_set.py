"""The result as a configuration set: files of the set of the run, with the estimates in their places.

Sources are beside the figures: in settings.toml as comments, in the CSV files in a last column without a
name, which the loader reads as notes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from simmer_tui.calibrate.estimates import ParameterEstimate, unidentified_labels
from simmer_tui.calibrate.fit import Fit
from simmer_tui.calibrate.parameters import with_parameter_values
from simmer_tui.config import drive_csv, sensors_csv, settings_file
from simmer_tui.config.csv_table import csv_text, plain_rows
from simmer_tui.config.importer.set_writer import drive_csv_text, sensors_csv_text
from simmer_tui.config.loader import Configuration
from simmer_tui.config.sets import write_files
from simmer_tui.config.settings import all_settings, value_of
from simmer_tui.config.settings_file import settings_text
from simmer_tui.errors import CalibrationError, reason_of
from simmer_tui.runlog.logged_devices import same_files
from simmer_tui.runlog.typed_json import TypedJson
from simmer_tui.sim.sensors import ParameterKind
from simmer_tui.sim.specs import SimulationSpec

KNOWLEDGE = "calibration.json"
"""The file with estimates and their covariance, for `simmer-tui calibrate --check`."""
CALIBRATION_PAGE = "calibration.html"
_DIGITS = 5
"""Significant digits in the files: estimates are seldom known to four."""
_PROFILES = {"sensor_profile": (), "drive_profile": "", "link_profile": "", "realistic": False}
"""Settings without profiles: their values are in the CSV files now."""
_OF_THE_RUN = {"sim": True, "randbias": False}


class Knowledge(msgspec.Struct, frozen=True, kw_only=True):
    """Estimates of a robot: parameters by name, with their values and covariance; noise scales and shares,
    with value and interval."""

    logs: tuple[str, ...] = ()
    misfits: tuple[str, ...] = ()
    parameters: tuple[str, ...]
    values: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    noise_scales: dict[str, tuple[float, float, float]] = {}
    shares: dict[str, tuple[float, float, float]] = {}


_KNOWLEDGE: TypedJson[Knowledge] = TypedJson(Knowledge)


def learned_spec(spec: SimulationSpec, estimates: Sequence[ParameterEstimate]) -> SimulationSpec:
    """The specification with every parameter that was identified."""
    rows = {each.kind.value: (True, i) for i, each in enumerate(spec.drives)}
    rows |= {each.id: (False, i) for i, each in enumerate(spec.sensors)}
    return with_parameter_values(
        spec,
        (
            (*rows[each.owner], each.field, _within(each.field, float(f"{each.value:.{_DIGITS}g}")))
            for each in estimates
            if each.identified and each.owner in rows
        ),
    )


def _within(field: str, value: float) -> float:
    """A share or standard deviation, limited to the range that sensors.csv allows."""
    return min(max(value, 0.0), 1.0) if field in ("error", "dropout", "outlier") else value


def device_texts(configuration: Configuration) -> dict[str, str]:
    """The device files of the run's set, by their paths in it. A log has no code, so that RunLogError is
    raised if one is no longer in its place."""
    remedy = "put it there, since the set that is written needs it too"
    files = same_files(configuration.device_statuses, configuration.directory, remedy)
    return {file.path: file.text for file in files}


def set_texts(fit: Fit, estimates: Sequence[ParameterEstimate]) -> dict[str, str]:
    """The files of the set by name. Raises the errors of `device_texts`."""
    run = fit.run
    spec = learned_spec(run.spec, estimates)
    texts = {**run.configuration.files, **device_texts(run.configuration)}
    source = f"calibrated from {', '.join(run.names)}"
    notes = _notes(estimates, source)
    texts[drive_csv.FILE] = _noted(drive_csv_text(spec.drives, spec.gripper, spec.velocities), notes)
    texts[sensors_csv.FILE] = _noted(sensors_csv_text(spec.sensors), notes)
    texts[settings_file.FILE] = _settings(fit, estimates, source)
    texts[KNOWLEDGE] = json.dumps(msgspec.to_builtins(knowledge_of(fit, estimates)), indent=1)
    return texts


def _notes(estimates: Sequence[ParameterEstimate], source: str) -> dict[str, str]:
    """Notes on rows, by ID: intervals and their logs, or the reason why there is no estimate."""
    intervals: dict[str, list[str]] = {}
    for each in estimates:
        if each.identified:
            _, low, high = each.shown
            interval = f"{each.label} {low} to {high} {each.unit}".rstrip()
            intervals.setdefault(each.owner, []).append(interval)
    notes = {owner: [f"{source}; 95 % intervals: {'; '.join(said)}"] for owner, said in intervals.items()}
    for (owner, why), labels in unidentified_labels(estimates).items():
        notes.setdefault(owner, []).append(f"{', '.join(labels)} as before: {why}")
    return {owner: "; ".join(said) for owner, said in notes.items()}


def _noted(text: str, notes: dict[str, str]) -> str:
    """A CSV file with notes in a last column without a name."""
    head, *rows = plain_rows(text)
    return csv_text([[*head, ""], *([*row, notes.get(row[0], "")] for row in rows)])


def _settings(fit: Fit, estimates: Sequence[ParameterEstimate], source: str) -> str:
    configuration = fit.run.configuration
    values: dict[str, Any] = {
        item.name: value_of(configuration.settings, item.name) for item in all_settings()
    }
    values |= _PROFILES | _OF_THE_RUN
    # It describes this robot: a difference from the set it was driven with is not a fault.
    values["nominal"] = ""
    comments = {"randbias": f"{source}: the biases of drive.csv are this robot's own."}
    latency = next((each for each in estimates if each.owner == "link"), None)
    if latency is not None and latency.identified:
        # Durations are known to half a millisecond.
        values["link.latency"] = float(f"{latency.value:.3g}")
        _, low, high = latency.shown
        comments["link.latency"] = f"{source}: {low} to {high} s."
    lines: list[str] = []
    table = ""
    for line in settings_text(values).splitlines():
        if line.startswith("["):
            table = f"{line.strip('[]')}."
        key = table + line.partition(" = ")[0]
        if " = " in line and key in comments:
            lines.append(f"# {comments[key]}")
        lines.append(line)
    return "\n".join(lines) + "\n"


def knowledge_of(fit: Fit, estimates: Sequence[ParameterEstimate]) -> Knowledge:
    """The estimates by name, with the covariance of the identified parameters."""
    identified = np.flatnonzero(fit.identified)
    covariance = fit.covariance[np.ix_(identified, identified)]
    return Knowledge(
        logs=tuple(fit.run.names),
        misfits=tuple(each.text for each in fit.misfits),
        parameters=tuple(fit.space.parameters[i].name for i in identified),
        # Offsets are relative to the sensors' places in the written set.
        values=tuple(
            0.0 if fit.space.parameters[i].kind is ParameterKind.OFFSET else float(fit.state.parameters[i])
            for i in identified
        ),
        covariance=tuple(tuple(float(f"{v:.6g}") for v in row) for row in covariance),
        noise_scales={
            each.parameter.name: (each.value, each.low, each.high)
            for each in estimates
            if each.identified and each.parameter is not None and each.parameter.kind is ParameterKind.NOISE
        },
        shares={
            f"{each.owner} {each.label}": (each.value, each.low, each.high)
            for each in estimates
            if each.identified and each.parameter is None
        },
    )


def write_texts(texts: Mapping[str, str], directory: Path) -> None:
    """Write files into a folder, which is created if necessary. Raises ConfigurationError, before anything is
    written, if one already exists, or if the folder cannot be written."""
    write_files(directory, {name: texts[name].encode("utf-8", "surrogatepass") for name in sorted(texts)})


def read_knowledge(directory: Path, option: str = "--check") -> Knowledge:
    """The estimates that were written into a set, which was given with an option.

    Raises:
        CalibrationError: if the file is not there or damaged.
    """
    path = directory / KNOWLEDGE
    shown = str(path)
    try:
        found = _KNOWLEDGE.decode(path.read_bytes())
        count = len(found.parameters)
        if {len(found.values), len(found.covariance), *map(len, found.covariance)} - {count}:
            raise ValueError("its parts are of different sizes")
    except OSError as error:
        raise CalibrationError(
            f"{shown} cannot be read ({reason_of(error)}); {option} takes a set that "
            "simmer-tui calibrate wrote"
        ) from None
    except ValueError as error:
        raise CalibrationError(f"{shown} is damaged: {error}") from None
    return found
